//! Scalogram on demand with any wavelet, with the newest CWT features beside it.

use super::error::ApiError;
use super::extract::{Path, Query, State, in_range};
use super::signals::{Run, fetch, samples_in};
use super::spectra::MIN_WINDOW_SAMPLES;
use super::state::{ApiState, channel, newest};
use super::turning::{Turner, Watched, last_whole};
use super::view::MachineView;
use super::wire::joint::WaveletName;
use super::wire::problem::ProblemWire;
use super::wire::signals::{AngleFrom, FeatureWire, ScalogramWire};
use super::wire::{finite, finite_column};
use crate::dsp::cwt::{CONE_SIGMA, DEFAULT_OMEGA0, Part, ScalogramPlan};
use crate::dsp::fft::{FftCache, ForwardPlan};
use crate::dsp::wavelet::picture::WaveletScalogramPlan;
use crate::dsp::wavelet::shape::Shape;
use crate::signal::{ChannelIndex, ChannelInfo};
use axum::Json;
use rustfft::num_complex::Complex;
use serde::Deserialize;
use std::f64::consts::TAU;
use std::ops::Range;
use utoipa::IntoParams;

/// Most samples times frequencies: bounds the coefficients held while computing (8 bytes each).
const MAX_WORK: usize = 33_554_432;

/// Which scalogram.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct CwtQuery {
    /// Mother wavelet; f is where its transform is largest. `morlet` tells lines apart, the others show when something happens.
    #[serde(default)]
    #[param(inline)]
    wavelet: WaveletName,
    /// Length analysed, s.
    #[param(minimum = 0.001, maximum = 60.0, default = 1.0)]
    window_s: Option<f64>,
    /// Instead of `window_s`: so many whole revolutions of the shaft that the sensor listens to, the newest, wholly outside
    /// the cone of influence.
    #[param(minimum = 1, maximum = 16)]
    revolutions: Option<usize>,
    /// One past the last sample; the newest by default.
    end: Option<u64>,
    /// Lowest frequency, Hz; by default 10 periods fill the window.
    min_hz: Option<f64>,
    /// Highest frequency, Hz; 0.4·fs by default.
    max_hz: Option<f64>,
    /// Frequencies, in equal ratios.
    #[param(minimum = 2, maximum = 256, default = 64)]
    n_frequencies: Option<usize>,
    /// Columns of time.
    #[param(minimum = 2, maximum = 2000, default = 200)]
    n_times: Option<usize>,
}

/// Gives the scalogram of the newest samples of a channel.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/channels/{name}/cwt",
    tag = "signals",
    params(
        ("id" = String, Path, description = "Machine id"),
        ("name" = String, Path, description = "Channel name"),
        CwtQuery,
    ),
    responses(
        (status = OK, body = ScalogramWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "`revolutions` of a shaft whose speed is not known"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Other spectra are being computed; see Retry-After"),
    )
)]
pub(super) async fn cwt(
    State(state): State<ApiState>,
    Path((id, name)): Path<(String, String)>,
    Query(query): Query<CwtQuery>,
) -> Result<Json<ScalogramWire>, ApiError> {
    let view = newest(state.machine(&id)?);
    let (index, info) = channel(&view, &name)?;
    let turner = match query.revolutions {
        Some(_) => Some(Turner::of_channel(&view, &name)?),
        None => None,
    };
    let mother = Mother::new(query.wavelet)?;
    let request = CwtRequest::new(&query, mother, info, turner.as_ref())?;
    let features = cwt_features(&view, ChannelIndex(index));
    let run = fetch(&state, &id, &name, query.end, request.n_window).await?;
    let watched = match turner {
        Some(turner) => Some(turner.watch(&state, &id, &run).await?),
        None => None,
    };
    let wire =
        state.compute(move || request.compute(name, &run, features, watched.as_ref())).await?;
    Ok(Json(wire))
}

/// A checked request.
#[derive(Debug)]
struct CwtRequest {
    mother: Mother,
    n_window: usize,
    frequency_hz: Vec<f64>,
    /// Columns shown.
    n_times: usize,
    /// Whole revolutions that are shown, if so asked.
    revolutions: Option<usize>,
}

/// A wavelet that can be asked for.
#[derive(Debug)]
struct Mother {
    name: WaveletName,
    /// None for Morlet's.
    shape: Option<Shape>,
}

/// The plan of a picture.
enum Picture {
    Morlet(ScalogramPlan<f32>),
    Other(Box<WaveletScalogramPlan<f32>>),
}

impl Mother {
    fn new(name: WaveletName) -> Result<Self, ApiError> {
        let shape = match name.shape() {
            Some(wavelet) => Some(Shape::new(wavelet).ok_or(ApiError::Internal)?),
            None => None,
        };
        Ok(Self { name, shape })
    }

    fn centre_rad(&self) -> f64 {
        self.shape.as_ref().map_or(DEFAULT_OMEGA0, Shape::peak_rad)
    }

    /// Half width of the cone of influence at f, times f.
    fn cone_periods(&self) -> f64 {
        self.shape.as_ref().map_or(CONE_SIGMA, |shape| shape.reach() * shape.peak_rad() / TAU)
    }

    fn plan(
        self,
        (n, fs_hz): (usize, f64),
        f_hz: &[f64],
        n_columns: usize,
        cache: &mut FftCache<f32>,
    ) -> Option<Picture> {
        match self.shape {
            Some(shape) => WaveletScalogramPlan::new(shape, (n, fs_hz), f_hz, n_columns, cache)
                .map(|plan| Picture::Other(Box::new(plan))),
            None => ScalogramPlan::new(n, fs_hz, f_hz, DEFAULT_OMEGA0, n_columns, cache)
                .map(Picture::Morlet),
        }
    }
}

impl Picture {
    fn out_len(&self) -> usize {
        match self {
            Self::Morlet(plan) => plan.out_len(),
            Self::Other(plan) => plan.out_len(),
        }
    }

    fn valid_columns(&self, row: usize) -> Range<usize> {
        let valid = match self {
            Self::Morlet(plan) => plan.valid_columns(row),
            Self::Other(plan) => plan.valid_columns(row),
        };
        valid.unwrap_or(0..0)
    }

    /// |W| of every row.
    fn process(&mut self, x_hat: &[Complex<f32>], out: &mut [f32]) {
        match self {
            Self::Morlet(plan) => plan.process(x_hat, Part::Modulus, out),
            Self::Other(plan) => plan.process(x_hat, Part::Modulus, out),
        }
    }
}

/// What of a picture is shown.
struct Shown {
    columns: Range<usize>,
    /// Angle of each column, where it comes from, the shaft and its speed.
    turning: Option<(Vec<f64>, AngleFrom, String, f64)>,
}

impl CwtRequest {
    fn new(
        query: &CwtQuery,
        mother: Mother,
        info: &ChannelInfo,
        turner: Option<&Turner>,
    ) -> Result<Self, ApiError> {
        let fs_hz = info.sample_rate.0;
        if query.revolutions.is_some() && query.window_s.is_some() {
            return Err(ApiError::Invalid(
                "window_s and revolutions exclude each other".to_owned(),
            ));
        }
        let revolutions = in_range("revolutions", query.revolutions, 1, 1, 16)?;
        let mut window_s = in_range("window_s", query.window_s, 1.0, 0.001, 60.0)?;
        if let Some(turner) = turner {
            window_s = revolutions as f64 / turner.speed.0;
        }
        let n_shown = samples_in(info, window_s);
        let n_rows = in_range("n_frequencies", query.n_frequencies, 64, 2, 256)?;
        let n_times = in_range("n_times", query.n_times, 200, 2, 2000)?;
        // The picture reaches beyond what is shown: a revolution for where it begins, and the cone at either end.
        let usual_floor_hz = 10.0 / window_s;
        let lowest_hz = query.min_hz.unwrap_or(usual_floor_hz).max(1.0 / window_s);
        let n_window = match turner {
            Some(turner) => {
                let cone = 2.0 * mother.cone_periods() / lowest_hz * turner.speed.0;
                turner.samples_of(info, revolutions as f64 + cone)
            }
            None => n_shown,
        };
        if n_shown < MIN_WINDOW_SAMPLES || n_window.saturating_mul(n_rows) > MAX_WORK {
            return Err(ApiError::Invalid(format!(
                "window_s is {window_s}, which is {n_window} samples of this channel, allowed are \
                 {MIN_WINDOW_SAMPLES} to {} for {n_rows} frequencies",
                MAX_WORK / n_rows
            )));
        }
        let (floor_hz, ceiling_hz) = (1.0 / window_s, 0.49 * fs_hz);
        let high_hz = in_range("max_hz", query.max_hz, 0.4 * fs_hz, floor_hz, ceiling_hz)?;
        let usual_hz = usual_floor_hz.min(high_hz / 2.0).max(floor_hz);
        let low_hz = in_range("min_hz", query.min_hz, usual_hz, floor_hz, ceiling_hz)?;
        if low_hz >= high_hz {
            return Err(ApiError::Invalid("min_hz must lie below max_hz".to_owned()));
        }
        let ratio = high_hz / low_hz;
        let frequency_hz =
            (0..n_rows).map(|row| low_hz * ratio.powf(row as f64 / (n_rows - 1) as f64)).collect();
        Ok(Self { mother, n_window, frequency_hz, n_times, revolutions: query.revolutions })
    }

    fn compute(
        self,
        channel: String,
        run: &Run,
        features: Vec<FeatureWire>,
        watched: Option<&Watched>,
    ) -> Result<ScalogramWire, ApiError> {
        let Run { info, waveform, validity } = run;
        let samples = &waveform.samples[..];
        let (n, fs_hz) = (samples.len(), info.sample_rate.0);
        let (n_columns, shown) = match watched {
            Some(watched) => self.of_revolutions(run, watched)?,
            None => (self.n_times, Shown { columns: 0..self.n_times, turning: None }),
        };
        let mut cache = FftCache::new();
        let (wavelet, omega0_rad) = (self.mother.name, self.mother.centre_rad());
        let plan = self.mother.plan((n, fs_hz), &self.frequency_hz, n_columns, &mut cache);
        let mut plan = plan.ok_or_else(|| {
            ApiError::NotFound(format!(
                "only {n} contiguous samples of {channel:?} are held, too few for these frequencies"
            ))
        })?;
        let mut forward = ForwardPlan::new(n, &mut cache);
        let mut x_hat = vec![Complex::new(0.0, 0.0); forward.n_bins()];
        forward.process(samples, &mut x_hat);
        let mut magnitude = vec![0.0_f32; plan.out_len()];
        plan.process(&x_hat, &mut magnitude);
        let Shown { columns, turning } = shown;
        let step_s = n as f64 / fs_hz / n_columns as f64;
        let valid = |row| {
            let valid = plan.valid_columns(row);
            let (from, to) = (valid.start.max(columns.start), valid.end.min(columns.end));
            if from < to { [from - columns.start, to - columns.start] } else { [0, 0] }
        };
        let row = |row: &[f32]| finite_column(row[columns.clone()].iter().map(|v| f64::from(*v)));
        let (angle_deg, angle_from, shaft, speed_hz) = match turning {
            Some((angles, from, shaft, speed_hz)) => {
                (Some(finite_column(angles)), Some(from), Some(shaft), finite(speed_hz))
            }
            None => (None, None, None, None),
        };
        Ok(ScalogramWire {
            channel,
            unit: info.unit.symbol().to_owned(),
            wavelet: wavelet.name(),
            omega0_rad,
            start_sample: waveform.start,
            n_samples: n,
            validity: *validity,
            frequency_hz: finite_column(self.frequency_hz.iter().copied()),
            time_s: finite_column(
                columns.clone().map(|i| waveform.start_time_s + i as f64 * step_s),
            ),
            angle_deg,
            angle_from,
            shaft,
            shaft_speed_hz: speed_hz,
            magnitude: magnitude.chunks(n_columns).map(row).collect(),
            valid_columns: (0..self.frequency_hz.len()).map(valid).collect(),
            features,
        })
    }

    /// Columns of a picture of all samples, and which of them are the newest whole revolutions outside the cone.
    fn of_revolutions(&self, run: &Run, watched: &Watched) -> Result<(usize, Shown), ApiError> {
        /// Most columns of a picture, shown or not.
        const MAX_COLUMNS: f64 = 16_384.0;
        let (n, fs_hz) = (run.waveform.samples.len(), run.info.sample_rate.0);
        let turns = watched.turns(run.waveform.start_time_s)?;
        let lowest_hz = self.frequency_hz.first().copied().unwrap_or(fs_hz);
        let margin_s = self.mother.cone_periods() / lowest_hz;
        let length_s = n as f64 / fs_hz;
        let wanted = self.revolutions.unwrap_or(1);
        let found = last_whole(&turns.track, (margin_s, length_s - margin_s), wanted);
        let (begin, last, [from_s, to_s]) = found.ok_or_else(|| {
            ApiError::NotFound(
                "no whole revolution of the shaft is held outside the cone of influence; ask for a higher min_hz"
                    .to_owned(),
            )
        })?;
        let per_second = self.n_times as f64 / (to_s - from_s);
        let n_columns = place((per_second * length_s).min(MAX_COLUMNS)).max(2);
        let step_s = length_s / n_columns as f64;
        let columns = place(from_s / step_s)..place(to_s / step_s).min(n_columns);
        let angle_deg = |column: usize| {
            let revolutions = turns.track.revolutions_at(column as f64 * step_s);
            revolutions.map_or(f64::NAN, |revolutions| 360.0 * (revolutions - begin))
        };
        let angles = columns.clone().map(angle_deg).collect();
        let speed_hz = (last - begin) / (to_s - from_s);
        let turning = Some((angles, turns.from, watched.turner.shaft().to_owned(), speed_hz));
        Ok((n_columns, Shown { columns, turning }))
    }
}

fn place(value: f64) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to int casts saturate, and the number is not negative"
    )]
    let place = value.round().max(0.0) as usize;
    place
}

/// The newest features of a channel that come from the CWT.
fn cwt_features(view: &MachineView, channel: ChannelIndex) -> Vec<FeatureWire> {
    view.features
        .iter()
        .filter(|features| features.channel == channel)
        .flat_map(|features| {
            let (start, end) = features.sample_range;
            features.values.iter().filter(|value| value.name.contains("cwt")).map(move |value| {
                FeatureWire {
                    name: value.name.to_string(),
                    value: finite(value.value),
                    unit: value.unit.symbol().to_owned(),
                    sample_range: [start, end],
                }
            })
        })
        .collect()
}
