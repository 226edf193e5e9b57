//! Which lines are accepted: proven ones, strongest first, each explaining others.

use super::candidate::Candidate;
use super::owner;
use super::place;
use super::place::Rival;
use crate::features::WindowFeatures;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::machine::BearingIndex;
use crate::signal::ChannelIndex;
use crate::units::Hz;

/// Relative error allowed when a line is matched to another's harmonic.
const MATCH_TOLERANCE: f64 = 5e-4;

/// Harmonics of a line that explain others together with their side bands.
const WITH_SIDE_BANDS: u32 = 4;

/// Harmonics of a line that explain others: blows have them all as high, and the fourth of a line one and a half times as
/// fast is the sixth of theirs; four times that covers rates up to three times as high.
const HARMONICS: u32 = 12;

/// An accepted line, and what it explains elsewhere.
#[derive(Debug, Clone)]
pub(super) struct Accepted<'a> {
    pub(super) frequency: Hz,
    pub(super) spacing: Hz,
    /// Channel it was heard in, and the power it carries there.
    pub(super) heard: (ChannelIndex, f64),
    /// The other bearings whose it may be by its rate alone, loudest first.
    pub(super) rivals: Vec<Rival>,
    /// Whose it is; several where it cannot be decided; none if it is heard best where it may be the
    /// shaft's events that passing elements modulate.
    pub(super) owners: Vec<&'a LineSearch>,
}

impl<'a> Accepted<'a> {
    /// Whether it is, or may be, this line of this bearing.
    pub(super) fn is_of(&self, bearing: BearingIndex, line: DefectLine) -> bool {
        self.owners.iter().any(|s| (s.bearing, s.line) == (bearing, line))
    }

    /// Whether it was accepted by `search`.
    pub(super) fn is_by(&self, search: &LineSearch) -> bool {
        self.owners.iter().any(|s| std::ptr::eq(*s, search))
    }

    /// The searches besides `search` that it may belong to as well.
    pub(super) fn others(&self, search: &LineSearch) -> Vec<&'a LineSearch> {
        self.owners.iter().copied().filter(|s| !std::ptr::eq(*s, search)).collect()
    }

    /// Whether `frequency` is this line's own.
    pub(super) fn is_at(&self, frequency: Hz, resolution: Hz) -> bool {
        let apart = (frequency.0 - self.frequency.0).abs();
        apart <= resolution.0 + MATCH_TOLERANCE * frequency.0
    }

    /// Whether `frequency` is a harmonic or side band of this line.
    pub(super) fn explains(&self, frequency: Hz, resolution: Hz) -> bool {
        let is_near = |place: f64| {
            (frequency.0 - place).abs() <= resolution.0 + MATCH_TOLERANCE * place.abs()
        };
        let has_side_band = |k: u32| {
            (-2..=2)
                .filter(|m| k != 0 || *m != 0)
                .any(|m| is_near(f64::from(k) * self.frequency.0 + f64::from(m) * self.spacing.0))
        };
        (0..=WITH_SIDE_BANDS).any(has_side_band)
            || (WITH_SIDE_BANDS + 1..=HARMONICS).any(|k| is_near(f64::from(k) * self.frequency.0))
    }
}

/// Searches of a bearing among which the strongest is picked: of each line in each channel and set of bands (C4, C51).
pub(super) fn n_looks(features: &WindowFeatures, bearing: BearingIndex) -> f64 {
    let own = features.bearing_lines.iter().filter(|s| s.bearing == bearing && s.outcome.is_ok());
    let n_hearings =
        1 + features.lower_lines.len() + usize::from(!features.between_lines.is_empty());
    (own.count() * n_hearings) as f64
}

/// Accepts proven lines, strongest first, for those they may belong to, until none is left that the accepted do not explain.
///
/// Cage lines come last and only for bearings without another: every defect's line carries the
/// cage rate as soon as the elements differ from one another.
pub(super) fn accept(features: &WindowFeatures) -> Vec<Accepted<'_>> {
    let mut accepted = Vec::new();
    accept_among(features, &mut accepted, |line| line != DefectLine::Ftf);
    let mut with_race: Vec<BearingIndex> =
        accepted.iter().flat_map(|a| a.owners.iter().map(|s| s.bearing)).collect();
    with_race.extend(doubtful_races(features, &accepted));
    accept_among(features, &mut accepted, |line| line == DefectLine::Ftf);
    accepted.retain_mut(|found| {
        let was_owned = !found.owners.is_empty();
        found.owners.retain(|s| s.line != DefectLine::Ftf || !with_race.contains(&s.bearing));
        !was_owned || !found.owners.is_empty()
    });
    accepted
}

/// Bearings with another line than the cage's that stands, whatever explains it: its elements may be
/// what the cage carries around.
fn doubtful_races<'a>(
    features: &'a WindowFeatures,
    accepted: &'a [Accepted<'_>],
) -> impl Iterator<Item = BearingIndex> + 'a {
    let of_elements = features.bearing_lines.iter().filter(|s| s.line != DefectLine::Ftf);
    of_elements
        .map(|s| Candidate::weigh_all(s, accepted, n_looks(features, s.bearing)))
        .filter(Candidate::is_proven)
        .map(|c| c.search.bearing)
}

pub(super) fn accept_among<'a>(
    features: &'a WindowFeatures,
    accepted: &mut Vec<Accepted<'a>>,
    eligible: impl Fn(DefectLine) -> bool,
) {
    loop {
        let next = features
            .bearing_lines
            .iter()
            .filter(|s| eligible(s.line))
            .filter(|s| !accepted.iter().any(|a| a.is_of(s.bearing, s.line)))
            .map(|s| Candidate::weigh(s, accepted, n_looks(features, s.bearing)))
            .filter(Candidate::is_proven)
            .max_by(|a, b| (a.depth() * a.part()).total_cmp(&(b.depth() * b.part())));
        let Some((candidate, best)) = next.as_ref().and_then(|c| c.best.as_ref().map(|b| (c, b)))
        else {
            return;
        };
        let search = heard_best(features, candidate, best.frequency, accepted);
        let heard = Candidate::weigh(search, accepted, n_looks(features, search.bearing));
        let is_own = heard.is_proven();
        let rivals = place::rivals(features, &heard, best.frequency, accepted);
        accepted.push(Accepted {
            frequency: best.frequency,
            spacing: search.side_band_spacing,
            heard: (search.channel, heard.power.heard()),
            rivals,
            owners: if is_own {
                owner::owners(features, search, best.frequency)
            } else {
                Vec::new()
            },
        });
    }
}

/// Among bearings with a sensor each that have a line at this rate, the same or another element's, it belongs to the one whose sensor shows it
/// with the most power, whatever makes it there. Those that share the candidate's channel are told apart by [`owner::owners`].
pub(super) fn heard_best<'a>(
    features: &'a WindowFeatures,
    candidate: &Candidate<'a>,
    frequency: Hz,
    accepted: &[Accepted<'_>],
) -> &'a LineSearch {
    features
        .bearing_lines
        .iter()
        .filter(|s| {
            let is_element = |s: &LineSearch| s.line != DefectLine::Ftf;
            let is_elsewhere = s.bearing != candidate.search.bearing;
            s.line == candidate.search.line
                || is_elsewhere && is_element(s) && is_element(candidate.search)
        })
        .filter(|s| s.channel != candidate.search.channel || std::ptr::eq(*s, candidate.search))
        .filter(|s| !accepted.iter().any(|a| a.is_of(s.bearing, s.line)))
        .map(|s| Candidate::weigh_all(s, accepted, n_looks(features, s.bearing)))
        .filter(Candidate::is_proven)
        .filter(|c| {
            let near = c.search.resolution.0 + MATCH_TOLERANCE * frequency.0;
            c.best.as_ref().is_some_and(|b| (b.frequency.0 - frequency.0).abs() <= near)
        })
        .filter(|c| !candidate.outdoes_events_at(c.search))
        .max_by(|a, b| a.power.heard().total_cmp(&b.power.heard()))
        .map_or(candidate.search, |c| c.search)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blows_explain_their_high_harmonics() {
        let (frequency, spacing) = (Hz(53.682), Hz(15.0));
        let heard = (ChannelIndex(0), 1.0);
        let line = Accepted { frequency, spacing, heard, rivals: Vec::new(), owners: Vec::new() };
        let explains = |f: f64| line.explains(Hz(f), Hz(0.39));
        assert!(explains(6.0 * 53.682) && explains(12.0 * 53.682) && !explains(13.0 * 53.682));
        // The fourth harmonic of 80.45 Hz is their sixth.
        assert!(explains(4.0 * 80.45) && !explains(80.45));
        assert!(explains(4.0 * 53.682 + 30.0) && !explains(5.0 * 53.682 + 30.0), "side bands");
    }
}
