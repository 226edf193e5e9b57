//! The points of a trend on their way to JSON: those of the store and of memory joined, thinned, their gaps laid open.

use super::error::ApiError;
use super::pairs::worse;
use super::view::Trend;
use super::wire::signals::{TrendColumnWire, TrendPointsWire, Validity};
use super::wire::{finite, finite_column, rfc3339};
use crate::dsp::real::floor_index;
use crate::plot::decimate;
use crate::signal::Timestamp;
use crate::store::trends::{Table, Tier};

/// Distance of two points, in those that are usual, from which there is a gap between them.
const GAP: f64 = 1.5;

/// How a trend is shown.
pub(super) struct Part {
    pub(super) tier: Tier,
    pub(super) start: Option<Timestamp>,
    pub(super) max_points: usize,
    /// What is known of what it rests on, gaps apart.
    pub(super) validity: Validity,
}

/// A trend on its way to JSON, from wherever it comes.
#[derive(Default)]
pub(super) struct Columns {
    pub(super) time_s: Vec<f64>,
    pub(super) columns: Vec<Shown>,
    /// Samples of each window; empty for minutes and hours, and of components.
    n_samples: Vec<Option<u64>>,
    unreadable: Vec<String>,
}

/// A feature of it.
pub(super) struct Shown {
    name: String,
    unit: &'static str,
    pub(super) value: Vec<f64>,
    low: Vec<f64>,
    high: Vec<f64>,
    /// Windows of each minute or hour; empty for windows.
    n: Vec<f64>,
}

impl Columns {
    /// The same of a component, whose verdicts rest on several channels.
    pub(super) fn without_samples(self) -> Self {
        Self { n_samples: Vec::new(), ..self }
    }

    /// Whether there is no point.
    pub(super) fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }
}

/// What a shard holds.
pub(super) fn of_memory(trend: &Trend) -> Columns {
    let columns = trend.columns.iter().map(|(name, unit, values)| Shown {
        name: name.clone(),
        unit: unit.symbol(),
        value: values.clone(),
        low: Vec::new(),
        high: Vec::new(),
        n: Vec::new(),
    });
    let (time_s, columns) = (trend.time_s.clone(), columns.collect());
    let n_samples = trend.n_samples.iter().copied().map(Some).collect();
    Columns { time_s, columns, n_samples, unreadable: Vec::new() }
}

/// What the store holds. `rate_hz`: of the channel in the stream that runs; `None`: it has none.
pub(super) fn of_store(table: &Table, rate_hz: Option<f64>) -> Columns {
    let wide = |values: &[f32]| values.iter().copied().map(f64::from).collect();
    let columns = table.columns.iter().map(|column| Shown {
        name: column.name.to_string(),
        unit: column.unit.symbol(),
        value: wide(&column.value),
        low: wide(&column.low),
        high: wide(&column.high),
        n: wide(&column.n),
    });
    let (time_s, unreadable) = (table.time_s.clone(), table.unreadable.clone());
    // Windows of an earlier stream, of no length here, may have had another rate.
    let n_samples = |duration_s: &f64| {
        let n = (duration_s * rate_hz?).round();
        (n >= 0.0).then(|| floor_index(n) as u64)
    };
    let n_samples = table.duration_s.iter().map(n_samples).collect();
    Columns { time_s, columns: columns.collect(), n_samples, unreadable }
}

/// Adds what memory holds behind what is stored, inside the span.
pub(super) fn append(
    columns: &mut Columns,
    memory: &Columns,
    (from, to): (Timestamp, Timestamp),
    start: Option<Timestamp>,
) {
    let newest_s = columns.time_s.last().copied().unwrap_or(f64::NEG_INFINITY);
    let at = |time_s: f64| start.unwrap_or_default().plus_seconds(time_s);
    let is_new = |time_s: f64| time_s > newest_s + 1e-6 && at(time_s) >= from && at(time_s) < to;
    let places: Vec<usize> =
        (0..memory.time_s.len()).filter(|place| is_new(memory.time_s[*place])).collect();
    if places.is_empty() {
        return;
    }
    let n_before = columns.time_s.len();
    columns.time_s.extend(places.iter().map(|place| memory.time_s[*place]));
    if !memory.n_samples.is_empty() {
        let n_samples = places.iter().map(|place| memory.n_samples.get(*place).copied().flatten());
        columns.n_samples.extend(n_samples);
    }
    for held in &memory.columns {
        let at = columns.columns.iter().position(|column| column.name == held.name);
        let at = at.unwrap_or_else(|| {
            let (name, unit, value) = (held.name.clone(), held.unit, vec![f64::NAN; n_before]);
            let (low, high, n) = (Vec::new(), Vec::new(), Vec::new());
            columns.columns.push(Shown { name, unit, value, low, high, n });
            columns.columns.len() - 1
        });
        let values = places.iter().map(|place| held.value.get(*place).copied().unwrap_or(f64::NAN));
        columns.columns[at].value.extend(values);
    }
    for column in &mut columns.columns {
        column.value.resize(columns.time_s.len(), f64::NAN);
    }
}

/// Thins a trend and lays its gaps open.
pub(super) fn shown(
    trend: &Columns,
    part: &Part,
    wanted: Option<&[String]>,
    of: &str,
) -> Result<TrendPointsWire, ApiError> {
    let known = |wanted: &&String| trend.columns.iter().any(|column| column.name == **wanted);
    if !trend.is_empty()
        && let Some(missing) = wanted.into_iter().flatten().find(|wanted| !known(wanted))
    {
        let names: Vec<&str> = trend.columns.iter().map(|column| column.name.as_str()).collect();
        return Err(ApiError::Invalid(format!(
            "no feature {missing:?} of {of:?} is held, allowed are: {}",
            names.join(", ")
        )));
    }
    let n_windows = trend.time_s.len();
    let gaps = gaps(&trend.time_s, part.tier);
    let is_wanted = |c: &&Shown| wanted.is_none_or(|wanted| wanted.contains(&c.name));
    let columns = trend.columns.iter().filter(is_wanted);
    let is_whole = n_windows > 0 && gaps.is_empty();
    let of_points = if is_whole { Validity::Ok } else { Validity::Gap };
    Ok(TrendPointsWire {
        validity: worse(part.validity, of_points),
        decimated: n_windows > part.max_points,
        n_windows,
        tier: part.tier.into(),
        start_time: part.start.map(|start| rfc3339(Some(start), 0.0)),
        gaps: gaps
            .iter()
            .map(|place| [finite(trend.time_s[*place]), finite(trend.time_s[place + 1])])
            .collect(),
        unreadable: trend.unreadable.clone(),
        features: columns.map(|c| column(c, trend, &gaps, part.max_points)).collect(),
    })
}

/// Places after which points are missing.
fn gaps(time_s: &[f64], tier: Tier) -> Vec<usize> {
    let mut steps: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let after = |steps: &[f64], usual_s: f64| -> Vec<usize> {
        let is_gap = |step: &f64| *step > GAP * usual_s;
        steps.iter().enumerate().filter(|(_, s)| is_gap(s)).map(|(place, _)| place).collect()
    };
    if let Some(step_s) = tier.step_s() {
        return after(&steps, step_s as f64);
    }
    let all = steps.clone();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).map_or(Vec::new(), |usual_s| after(&all, *usual_s))
}

/// One feature, thinned so that its extremes stay; each gap is a point without a value.
fn column(shown: &Shown, trend: &Columns, gaps: &[usize], max_points: usize) -> TrendColumnWire {
    let time_s = &trend.time_s;
    let n = time_s.len().min(shown.value.len());
    let is_coarse = !shown.low.is_empty();
    let mut kept = if is_coarse {
        // The extremes of minutes and hours stand beside their means.
        let mut both = decimate::min_max(n, (max_points / 2).max(2), |i| shown.low[i]);
        both.extend(decimate::min_max(n, (max_points / 2).max(2), |i| shown.high[i]));
        if n <= max_points { (0..n).collect() } else { both }
    } else {
        decimate::min_max(n, max_points, |i| shown.value[i])
    };
    kept.sort_unstable();
    kept.dedup();
    let slots = with_gaps(&kept, gaps);
    let with = |from: &[f64]| {
        finite_column(slots.iter().map(|slot| match slot {
            Slot::Point(place) => from[*place],
            Slot::Gap(_) => f64::NAN,
        }))
    };
    let times = slots.iter().map(|slot| match slot {
        Slot::Point(place) => time_s[*place],
        Slot::Gap(place) => 0.5 * (time_s[*place] + time_s[place + 1]),
    });
    let times = finite_column(times);
    // A value of a window rests on that window alone.
    let n_windows = |place: usize| match shown.n.get(place) {
        Some(n) => floor_index(*n),
        None => usize::from(!shown.value[place].is_nan()),
    };
    let n_samples = |place: usize| {
        trend.n_samples.get(place).copied().flatten().filter(|_| !shown.value[place].is_nan())
    };
    let extremes = |from: &[f64]| if is_coarse { with(from) } else { Vec::new() };
    TrendColumnWire {
        name: shown.name.clone(),
        unit: shown.unit.to_owned(),
        time_s: times,
        value: with(&shown.value),
        low: extremes(&shown.low),
        high: extremes(&shown.high),
        windows: slots.iter().map(|slot| slot.place().map_or(0, n_windows)).collect(),
        n_samples: if trend.n_samples.is_empty() {
            Vec::new()
        } else {
            slots.iter().map(|slot| slot.place().and_then(n_samples)).collect()
        },
    }
}

/// A point that is shown, or the gap behind a point.
enum Slot {
    Point(usize),
    Gap(usize),
}

impl Slot {
    /// The place of a point; `None`: a gap.
    fn place(&self) -> Option<usize> {
        match self {
            Self::Point(place) => Some(*place),
            Self::Gap(_) => None,
        }
    }
}

/// The points that are kept, with the gaps between them; of several gaps between two points the last.
fn with_gaps(kept: &[usize], gaps: &[usize]) -> Vec<Slot> {
    let mut slots = Vec::with_capacity(kept.len());
    let mut next = gaps.iter().copied().peekable();
    for place in kept {
        let mut gap = None;
        while let Some(before) = next.next_if(|gap| gap < place) {
            gap = Some(before);
        }
        slots.extend(gap.filter(|_| !slots.is_empty()).map(Slot::Gap));
        slots.push(Slot::Point(*place));
    }
    slots
}
