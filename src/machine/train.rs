//! Speed ratios from shaft to shaft.
//!
//! Every stated ratio and every gear is a link; links join shafts into groups that turn together.
//! Where several paths join two shafts they must agree. Equation K8 of
//! `docs/theory.md`. Must not know of files: it reports conflicts by link number.

use super::ShaftIndex;
use crate::units::Hz;

/// Two paths through the train agree when their ratios differ by no more than this, relatively.
///
/// Tooth counts are whole numbers, so that only rounding separates true paths.
pub const RATIO_TOLERANCE: f64 = 1e-6;

/// A stated speed agrees with the train when it is off by no more than this, relatively.
///
/// Nominal speeds are rounded from name plates.
pub const SPEED_TOLERANCE: f64 = 0.02;

/// Largest speed ratio of two shafts of one machine; its inverse is the smallest.
pub const MAX_RATIO: f64 = 1e6;

/// speed(`to`) = `ratio` · speed(`from`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Shaft whose speed is multiplied.
    pub from: ShaftIndex,
    /// Shaft whose speed results.
    pub to: ShaftIndex,
    /// Ratio of the speeds, > 0 and finite.
    pub ratio: f64,
}

/// What the train tells of one shaft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShaftSpeed {
    /// Speed divided by the first shaft's; `None` when nothing connects the two.
    pub ratio_to_first: Option<f64>,
    /// Nominal speed; `None` when neither this shaft nor one it turns with states any.
    pub nominal: Option<Hz>,
}

/// Statements that cannot all be true.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TrainConflict {
    /// A link contradicts the path that earlier links make between its shafts.
    Ratio {
        /// Place of the link in the list.
        link: usize,
        /// The link's ratio.
        stated: f64,
        /// Ratio along the other path.
        by_other_path: f64,
    },
    /// With this link two shafts differ in speed by more than [`MAX_RATIO`].
    Extreme {
        /// Place of the link in the list.
        link: usize,
    },
    /// A stated nominal speed contradicts another through the train.
    Speed {
        /// The shaft that states it.
        shaft: ShaftIndex,
        /// Speed it states.
        stated: Hz,
        /// The shaft that was believed: the first of the group that states a speed.
        believed: ShaftIndex,
        /// Speed that follows from the believed shaft.
        by_train: Hz,
    },
}

/// Shafts with the group each belongs to and its speed relative to that group's unit.
struct Groups {
    group: Vec<usize>,
    speed: Vec<f64>,
}

/// Solves the train: ratios to the first shaft and nominal speeds.
///
/// `stated[i]` is shaft i's own nominal speed, > 0 and finite. In a group of joined shafts the
/// first that states a speed is believed, and the others follow from it. Groups that no link joins
/// are related by their nominal speeds when both have one.
///
/// # Errors
///
/// All contradictions, links first, in the order of the arguments.
///
/// # Panics
///
/// If a link names a shaft beyond `stated`.
pub fn solve(stated: &[Option<Hz>], links: &[Link]) -> Result<Vec<ShaftSpeed>, Vec<TrainConflict>> {
    let mut conflicts = Vec::new();
    let mut groups = Groups { group: (0..stated.len()).collect(), speed: vec![1.0; stated.len()] };
    for (index, link) in links.iter().enumerate() {
        conflicts.extend(groups.join(index, link));
    }
    let nominal = nominal_speeds(&groups, stated, &mut conflicts);
    if !conflicts.is_empty() {
        return Err(conflicts);
    }
    Ok((0..stated.len())
        .map(|shaft| ShaftSpeed {
            ratio_to_first: groups.ratio(0, shaft).or_else(|| {
                let (first, this) = (nominal[0]?, nominal[shaft]?);
                Some(this.0 / first.0)
            }),
            nominal: nominal[shaft],
        })
        .collect())
}

impl Groups {
    /// speed(b)/speed(a), if links join them.
    fn ratio(&self, a: usize, b: usize) -> Option<f64> {
        (self.group[a] == self.group[b]).then(|| self.speed[b] / self.speed[a])
    }

    /// Takes a link in, or says why it cannot be.
    fn join(&mut self, index: usize, link: &Link) -> Option<TrainConflict> {
        let (from, to) = (link.from.0, link.to.0);
        if let Some(by_other_path) = self.ratio(from, to) {
            let off = (link.ratio / by_other_path - 1.0).abs();
            return (off.is_nan() || off > RATIO_TOLERANCE).then_some(TrainConflict::Ratio {
                link: index,
                stated: link.ratio,
                by_other_path,
            });
        }
        let (kept, absorbed) = (self.group[from], self.group[to]);
        let factor = self.speed[from] * link.ratio / self.speed[to];
        let speeds = (0..self.group.len()).map(|shaft| {
            if self.group[shaft] == absorbed {
                self.speed[shaft] * factor
            } else {
                self.speed[shaft]
            }
        });
        let joined: Vec<f64> = speeds.collect();
        let members = || (0..joined.len()).filter(|&s| [kept, absorbed].contains(&self.group[s]));
        let fastest = members().map(|shaft| joined[shaft]).fold(f64::MIN_POSITIVE, f64::max);
        let slowest = members().map(|shaft| joined[shaft]).fold(f64::MAX, f64::min);
        let spread = fastest / slowest;
        if spread.is_nan() || spread > MAX_RATIO {
            return Some(TrainConflict::Extreme { link: index });
        }
        self.speed = joined;
        for group in self.group.iter_mut().filter(|group| **group == absorbed) {
            *group = kept;
        }
        None
    }
}

/// Gives every shaft the speed that follows from the first stated one of its group.
fn nominal_speeds(
    groups: &Groups,
    stated: &[Option<Hz>],
    conflicts: &mut Vec<TrainConflict>,
) -> Vec<Option<Hz>> {
    let mut believed: Vec<Option<(usize, Hz)>> = vec![None; stated.len()];
    for (shaft, &speed) in stated.iter().enumerate() {
        let Some(speed) = speed else { continue };
        let group = groups.group[shaft];
        let Some((source, source_speed)) = believed[group] else {
            believed[group] = Some((shaft, speed));
            continue;
        };
        let by_train = source_speed.0 * groups.speed[shaft] / groups.speed[source];
        if (speed.0 / by_train - 1.0).abs() > SPEED_TOLERANCE {
            conflicts.push(TrainConflict::Speed {
                shaft: ShaftIndex(shaft),
                stated: speed,
                believed: ShaftIndex(source),
                by_train: Hz(by_train),
            });
        }
    }
    (0..stated.len())
        .map(|shaft| {
            let (source, speed) = believed[groups.group[shaft]]?;
            if source == shaft {
                return Some(speed);
            }
            Some(Hz(speed.0 * groups.speed[shaft] / groups.speed[source]))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(from: usize, to: usize, ratio: f64) -> Link {
        Link { from: ShaftIndex(from), to: ShaftIndex(to), ratio }
    }

    #[test]
    fn two_stages_multiply() {
        // 32:80 then 48:64 from 30 Hz.
        let links = [link(0, 1, 32.0 / 80.0), link(1, 2, 48.0 / 64.0)];
        let speeds = solve(&[Some(Hz(30.0)), None, None], &links).unwrap();
        // One product of two short fractions: rounding only.
        assert!((speeds[1].nominal.unwrap().0 - 12.0).abs() < 1e-13);
        assert!((speeds[2].nominal.unwrap().0 - 9.0).abs() < 1e-13);
        assert!((speeds[2].ratio_to_first.unwrap() - 0.3).abs() < 1e-15);
        assert_eq!(speeds[0].ratio_to_first, Some(1.0));
    }

    #[test]
    fn a_speed_stated_anywhere_reaches_the_first_shaft() {
        let speeds = solve(&[None, Some(Hz(5.0))], &[link(1, 0, 4.0)]).unwrap();
        assert_eq!(speeds[0].nominal, Some(Hz(20.0)));
        assert_eq!(speeds[1].ratio_to_first, Some(0.25));
    }

    #[test]
    fn groups_without_a_link_are_related_by_their_speeds_or_not_at_all() {
        let speeds = solve(&[Some(Hz(10.0)), Some(Hz(25.0)), None], &[]).unwrap();
        assert_eq!(speeds[1].ratio_to_first, Some(2.5));
        assert_eq!(speeds[2], ShaftSpeed { ratio_to_first: None, nominal: None });
    }

    #[test]
    fn loops_must_close() {
        let closing = [link(0, 1, 0.5), link(1, 2, 3.0), link(0, 2, 1.5)];
        assert!(solve(&[None; 3], &closing).is_ok());
        let open = [link(0, 1, 0.5), link(1, 2, 3.0), link(0, 2, 1.500_01)];
        let conflicts = solve(&[None; 3], &open).unwrap_err();
        assert!(matches!(conflicts[..], [TrainConflict::Ratio { link: 2, .. }]), "{conflicts:?}");
    }

    #[test]
    fn a_link_between_two_groups_keeps_the_ratios_inside_them() {
        let links = [link(0, 1, 2.0), link(2, 3, 3.0), link(1, 3, 5.0)];
        let speeds = solve(&[None; 4], &links).unwrap();
        assert_eq!(speeds[3].ratio_to_first, Some(10.0));
        assert!((speeds[2].ratio_to_first.unwrap() - 10.0 / 3.0).abs() < 1e-14);
    }

    #[test]
    fn stated_speeds_may_be_rounded_but_not_wrong() {
        let links = [link(0, 1, 0.4)];
        // 29.5·0.4 = 11.8: 11.9 is 0.8 % off, 12.5 is 6 % off.
        assert!(solve(&[Some(Hz(29.5)), Some(Hz(11.9))], &links).is_ok());
        let conflicts = solve(&[Some(Hz(29.5)), Some(Hz(12.5))], &links).unwrap_err();
        assert!(matches!(
            conflicts[..],
            [TrainConflict::Speed { shaft: ShaftIndex(1), believed: ShaftIndex(0), .. }]
        ));
    }

    #[test]
    fn absurd_trains_are_refused_instead_of_overflowing() {
        let links: Vec<Link> = (0..900).map(|shaft| link(shaft, shaft + 1, 1e4)).collect();
        let conflicts = solve(&[None; 901], &links).unwrap_err();
        assert!(matches!(conflicts[0], TrainConflict::Extreme { link: 1 }), "{:?}", conflicts[0]);
    }
}
