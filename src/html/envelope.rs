//! The squared-envelope spectrum behind a bearing's verdict, with cursors at its lines.

use super::recording::Track;
use super::recording::find;
use crate::diagnosis::bearing::BETWEEN_EVENTS;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::Evidence;
use crate::dsp::envelope::EnvelopeSpectrumPlan;
use crate::dsp::envelope::SquaredEnvelopePlan;
use crate::dsp::envelope::bins_of_band;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::turn_gate;
use crate::features::MIN_WIDTH_PER_LINE;
use crate::features::bands;
use crate::features::bearing::DefectLine;
use crate::machine::Machine;
use crate::machine::bearing::FaultOrders;
use crate::plot::Words;
use crate::plot::chart::Chart;
use crate::plot::chart::Cursor;
use crate::plot::chart::Scale;
use crate::plot::decimate;
use crate::units::Hz;
use rustfft::num_complex::Complex;

/// Harmonics of the line that are marked, and of the shaft.
const HARMONICS: u32 = 3;
const SHAFT_HARMONICS: u32 = 6;

/// Points of a picture at most.
const POINTS_MAX: usize = 1600;

/// Indicators of the lines begin with this.
const INDICATOR: &str = "envelope_line_";

/// A picture and what to say of it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Figure {
    pub(super) svg: String,
    pub(super) caption: String,
}

/// Modulation depths of one band.
struct Depths {
    values: Vec<f32>,
    width_hz: f64,
    band: (Hz, Hz),
    /// Depth of the line over the median around it.
    prominence: f64,
}

/// The line a fault shows.
fn line_of(fault: FaultMode) -> Option<DefectLine> {
    match fault {
        FaultMode::InnerRace => Some(DefectLine::Bpfi),
        FaultMode::OuterRace => Some(DefectLine::Bpfo),
        FaultMode::RollingElement => Some(DefectLine::TwoBsf),
        FaultMode::Cage => Some(DefectLine::Ftf),
        FaultMode::Bow
        | FaultMode::Unbalance
        | FaultMode::Misalignment
        | FaultMode::Looseness
        | FaultMode::ToothDamage
        | FaultMode::DistributedWear
        | FaultMode::Dead
        | FaultMode::Clipped
        | FaultMode::Stuck
        | FaultMode::Spiking
        | FaultMode::Loose
        | FaultMode::Noisy
        | FaultMode::WrongRange
        | FaultMode::AbnormalLevel => None,
    }
}

/// The line that decided: that of the fault named, else the one that comes nearest to its threshold.
pub(super) fn deciding(component: &ComponentDiagnosis) -> Option<(DefectLine, &Evidence)> {
    let lines = component.evidence.iter().filter_map(|evidence| {
        let name = evidence.indicator.strip_prefix(INDICATOR)?;
        let slug = name.strip_suffix(BETWEEN_EVENTS).unwrap_or(name);
        evidence.frequency.or(evidence.expected)?;
        Some((DefectLine::ALL.into_iter().find(|line| line.slug() == slug)?, evidence))
    });
    let named = component.fault.and_then(line_of);
    let nearness = |e: &Evidence| e.value / e.threshold.unwrap_or(f64::INFINITY);
    let rank =
        |(line, evidence): &(DefectLine, &Evidence)| (Some(*line) == named, nearness(evidence));
    lines.max_by(|a, b| {
        let (a, b) = (rank(a), rank(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    })
}

/// The picture of a bearing; `None` if no line was read, or its samples are not there.
pub(super) fn figure(
    component: &ComponentDiagnosis,
    machine: &Machine,
    shaft_hz: f64,
    tracks: &[Track],
) -> Option<Figure> {
    let (line, evidence) = deciding(component)?;
    let track = find(tracks, &evidence.channel)?;
    // Several windows of a run-up are judged; what is drawn is the newest.
    let at_speed = evidence.order.filter(|_| track.even.is_some()).map(|o| Hz(o * shaft_hz));
    let found = at_speed.or(evidence.frequency).or(evidence.expected)?;
    let sensor = machine.sensors.iter().find(|sensor| sensor.channel == track.info.name)?;
    let (samples, rate) = track.for_lines();
    let is_between = evidence.indicator.ends_with(BETWEEN_EVENTS);
    // The speed of the bearing's own shaft.
    let without =
        evidence.order.filter(|order| is_between && *order > 0.0).map(|o| Hz(found.0 / o));
    let depths = best_band((samples, rate), bands::usable_band(sensor, rate), (found, without))?;
    let orders = machine.bearings.iter().find(|b| b.id == component.id)?.fault_orders()?;
    let top_hz = (f64::from(HARMONICS) + 0.4) * found.0.max(shaft_hz);
    let shown: Vec<usize> =
        (1..depths.values.len()).take_while(|k| *k as f64 * depths.width_hz <= top_hz).collect();
    let value = |i: usize| f64::from(depths.values[shown[i]]);
    let kept = decimate::peaks(shown.len(), POINTS_MAX, value);
    let points: Vec<(f64, f64)> =
        kept.iter().map(|i| (shown[*i] as f64 * depths.width_hz, value(*i))).collect();
    let largest = points.iter().map(|(_, depth)| *depth).fold(0.0, f64::max);
    let (low, high) = depths.band;
    let title =
        format!("Squared envelope of {}, {:.0} to {:.0} Hz", track.info.name, low.0, high.0);
    let svg = Chart {
        words: Words { title: &title, x: "frequency (Hz)", y: "modulation depth" },
        size: (860.0, 340.0),
        x: (0.0, top_hz),
        y: Scale::Linear(0.0, 1.05 * largest),
        lines: vec![("line", points)],
        cursors: cursors(line, found.0, shaft_hz, &orders),
    }
    .svg()?;
    let even = if track.even.is_some() {
        " The speed changes: this is drawn at equal angles of the shaft, and frequencies in the picture are those at the mean speed of the newest \
         window."
    } else {
        ""
    };
    let between = if without.is_some() {
        " Events of the shaft hide it: the eighth of the turn in which the signal is strongest is left out."
    } else {
        ""
    };
    let caption = caption(component, line, evidence, shaft_hz);
    Some(Figure { svg, caption: caption + between + even })
}

fn caption(
    component: &ComponentDiagnosis,
    line: DefectLine,
    evidence: &Evidence,
    shaft_hz: f64,
) -> String {
    let expected = evidence.expected.map_or(String::new(), |e| {
        format!(", expected at {:.2} Hz from the geometry and a shaft at {shaft_hz:.3} Hz", e.0)
    });
    let found =
        evidence.frequency.map_or("not found".to_owned(), |f| format!("found at {:.2} Hz", f.0));
    let bands = match line {
        DefectLine::Bpfi => ", side bands one shaft turn apart",
        DefectLine::TwoBsf => ", side bands one cage turn apart",
        DefectLine::Bpfo | DefectLine::Ftf => "",
    };
    let is_small = evidence.value < evidence.threshold.unwrap_or(0.0);
    let verdict = if component.state.is_accusation() && is_small {
        "Its growth or another sign accuses, which is told above: by itself the line is too small to."
    } else if component.state.is_accusation() {
        "A damaged surface is struck at this rate again and again, so the signal's strength rises and falls with it."
    } else {
        "A damaged surface would be struck at this rate; no line there rises far enough above its surroundings."
    };
    format!(
        "{verdict} Orange: {} {found}{expected}, and its harmonics{bands}. Green: where the other parts of the bearing \
         would show. Grey: multiples of the shaft speed. Of the bands read as measured this is the one in \
         which the line stands out most; the table gives the reading that decided.",
        line.name()
    )
}

fn cursors(line: DefectLine, found_hz: f64, shaft_hz: f64, orders: &FaultOrders) -> Vec<Cursor> {
    let cursor = |x: f64, label: String, class| Cursor { x, label, class };
    let mut cursors = Vec::new();
    let spacing_hz = match line {
        DefectLine::Bpfi => Some(shaft_hz),
        DefectLine::TwoBsf => Some(orders.ftf * shaft_hz),
        DefectLine::Bpfo | DefectLine::Ftf => None,
    };
    for harmonic in 1..=HARMONICS {
        let x = f64::from(harmonic) * found_hz;
        let name = if harmonic == 1 {
            line.name().to_owned()
        } else {
            format!("{harmonic}·{}", line.name())
        };
        cursors.push(cursor(x, name, "found"));
        if let Some(spacing_hz) = spacing_hz {
            let turn = if line == DefectLine::Bpfi { "1×" } else { "FTF" };
            cursors.push(cursor(x - spacing_hz, format!("−{turn}"), "band"));
            cursors.push(cursor(x + spacing_hz, format!("+{turn}"), "band"));
        }
    }
    for other in DefectLine::ALL.into_iter().filter(|other| *other != line) {
        let order = match other {
            DefectLine::Bpfi => orders.bpfi,
            DefectLine::Bpfo => orders.bpfo,
            DefectLine::TwoBsf => orders.two_bsf(),
            DefectLine::Ftf => orders.ftf,
        };
        cursors.push(cursor(order * shaft_hz, other.name().to_owned(), "rate"));
    }
    let shaft = |n| cursor(f64::from(n) * shaft_hz, format!("{n}×"), "shaft");
    cursors.extend((1..=SHAFT_HARMONICS).map(shaft));
    cursors
}

/// Of the bands that are searched, the one in which the line stands out most; `without`: the shaft whose events are left out.
fn best_band(
    (samples, rate): (&[f32], Hz),
    usable: (Hz, Hz),
    (line, without): (Hz, Option<Hz>),
) -> Option<Depths> {
    let mut cache = FftCache::new();
    let n = samples.len();
    if n < 64 {
        return None;
    }
    let mut forward = ForwardPlan::new(n, &mut cache);
    let mut x_hat = vec![Complex::new(0.0, 0.0); forward.n_bins()];
    forward.process(samples, &mut x_hat);
    let whole = bands::demodulation_bands(usable, Hz(MIN_WIDTH_PER_LINE * line.0), bands::LEVELS);
    let lower = bands::lower_sets(usable, line, bands::LEVELS);
    let bands = whole.into_iter().chain(lower.into_iter().flatten());
    let depths = bands.filter(|band| !band.whitened).filter_map(|band| {
        let bins = bins_of_band(n, rate.0, band.low.0, band.high.0)?;
        let mut squared = SquaredEnvelopePlan::new(n, bins, &mut cache);
        let mut spectrum = EnvelopeSpectrumPlan::new(squared.out_len(), &mut cache);
        let mut e2 = vec![0.0; squared.out_len()];
        let mut values = vec![0.0; spectrum.n_bins()];
        squared.process(&x_hat, &mut e2);
        if let Some(shaft) = without {
            turn_gate::leave_out_loudest(&mut e2, shaft.0 / squared.out_rate_hz(rate.0));
        }
        spectrum.process(&e2, &mut values)?;
        let width_hz = spectrum.bin_width_hz(squared.out_rate_hz(rate.0));
        let prominence = prominence(&values, line.0 / width_hz)?;
        Some(Depths { values, width_hz, band: (band.low, band.high), prominence })
    });
    depths.max_by(|a, b| a.prominence.total_cmp(&b.prominence))
}

/// The value at a place over the median of the values from half to one and a half times as far.
fn prominence(values: &[f32], place: f64) -> Option<f64> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to int casts saturate, and the number is not negative"
    )]
    let bin = |at: f64| at.max(0.0).round() as usize;
    let near = values.get(bin(place).saturating_sub(2)..bin(place) + 3)?;
    let peak = near.iter().copied().fold(0.0, f32::max);
    let mut around = values.get(bin(0.5 * place)..bin(1.5 * place).min(values.len()))?.to_vec();
    around.sort_by(f32::total_cmp);
    let median = *around.get(around.len() / 2)?;
    (median > 0.0).then(|| f64::from(peak) / f64::from(median))
}
