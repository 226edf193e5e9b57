//! Scalogram on demand, with the newest CWT features beside it.

use super::error::ApiError;
use super::extract::{Path, Query, State, in_range};
use super::signals::{Run, fetch, samples_in};
use super::spectra::MIN_WINDOW_SAMPLES;
use super::state::{ApiState, channel, newest};
use super::view::MachineView;
use super::wire::problem::ProblemWire;
use super::wire::signals::{FeatureWire, ScalogramWire};
use super::wire::{finite, finite_column};
use crate::dsp::cwt::{DEFAULT_OMEGA0, Part, ScalogramPlan};
use crate::dsp::fft::{FftCache, ForwardPlan};
use crate::signal::{ChannelIndex, ChannelInfo};
use axum::Json;
use rustfft::num_complex::Complex;
use serde::Deserialize;
use utoipa::IntoParams;

/// Most samples times frequencies: bounds the coefficients held while computing (8 bytes each).
const MAX_WORK: usize = 33_554_432;

/// Which scalogram.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct CwtQuery {
    /// Length analysed, s.
    #[param(minimum = 0.001, maximum = 60.0, default = 1.0)]
    window_s: Option<f64>,
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

/// Gives the Morlet scalogram of the newest samples of a channel.
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
    let request = CwtRequest::new(&query, info)?;
    let features = cwt_features(&view, ChannelIndex(index));
    let run = fetch(&state, &id, &name, query.end, request.n_window).await?;
    let wire = state.compute(move || request.compute(name, &run, features)).await?;
    Ok(Json(wire))
}

/// A checked request.
#[derive(Debug)]
struct CwtRequest {
    n_window: usize,
    frequency_hz: Vec<f64>,
    n_times: usize,
}

impl CwtRequest {
    fn new(query: &CwtQuery, info: &ChannelInfo) -> Result<Self, ApiError> {
        let fs_hz = info.sample_rate.0;
        let window_s = in_range("window_s", query.window_s, 1.0, 0.001, 60.0)?;
        let n_window = samples_in(info, window_s);
        let n_rows = in_range("n_frequencies", query.n_frequencies, 64, 2, 256)?;
        let n_times = in_range("n_times", query.n_times, 200, 2, 2000)?;
        if n_window < MIN_WINDOW_SAMPLES || n_window.saturating_mul(n_rows) > MAX_WORK {
            return Err(ApiError::Invalid(format!(
                "window_s is {window_s}, which is {n_window} samples of this channel, allowed are \
                 {MIN_WINDOW_SAMPLES} to {} for {n_rows} frequencies",
                MAX_WORK / n_rows
            )));
        }
        let (floor_hz, ceiling_hz) = (1.0 / window_s, 0.49 * fs_hz);
        let high_hz = in_range("max_hz", query.max_hz, 0.4 * fs_hz, floor_hz, ceiling_hz)?;
        let usual_hz = (10.0 / window_s).min(high_hz / 2.0).max(floor_hz);
        let low_hz = in_range("min_hz", query.min_hz, usual_hz, floor_hz, ceiling_hz)?;
        if low_hz >= high_hz {
            return Err(ApiError::Invalid("min_hz must lie below max_hz".to_owned()));
        }
        let ratio = high_hz / low_hz;
        let frequency_hz =
            (0..n_rows).map(|row| low_hz * ratio.powf(row as f64 / (n_rows - 1) as f64)).collect();
        Ok(Self { n_window, frequency_hz, n_times })
    }

    fn compute(
        &self,
        channel: String,
        run: &Run,
        features: Vec<FeatureWire>,
    ) -> Result<ScalogramWire, ApiError> {
        let Run { info, waveform, validity } = run;
        let samples = &waveform.samples[..];
        let (n, fs_hz) = (samples.len(), info.sample_rate.0);
        let mut cache = FftCache::new();
        let plan = ScalogramPlan::new(
            n,
            fs_hz,
            &self.frequency_hz,
            DEFAULT_OMEGA0,
            self.n_times,
            &mut cache,
        );
        let mut plan = plan.ok_or_else(|| {
            ApiError::NotFound(format!(
                "only {n} contiguous samples of {channel:?} are held, too few for these frequencies"
            ))
        })?;
        let mut forward = ForwardPlan::new(n, &mut cache);
        let mut x_hat = vec![Complex::new(0.0, 0.0); forward.n_bins()];
        forward.process(samples, &mut x_hat);
        let mut magnitude = vec![0.0_f32; plan.out_len()];
        plan.process(&x_hat, Part::Modulus, &mut magnitude);
        let rows = magnitude.chunks(self.n_times);
        let step_s = n as f64 / fs_hz / self.n_times as f64;
        let valid = |row| {
            let columns = plan.valid_columns(row).unwrap_or(0..0);
            if columns.is_empty() { [0, 0] } else { [columns.start, columns.end] }
        };
        Ok(ScalogramWire {
            channel,
            unit: info.unit.symbol().to_owned(),
            wavelet: "morlet".to_owned(),
            omega0_rad: DEFAULT_OMEGA0,
            start_sample: waveform.start,
            n_samples: n,
            validity: *validity,
            frequency_hz: finite_column(self.frequency_hz.iter().copied()),
            time_s: finite_column(
                (0..self.n_times).map(|i| waveform.start_time_s + i as f64 * step_s),
            ),
            magnitude: rows.map(|row| finite_column(row.iter().map(|v| f64::from(*v)))).collect(),
            valid_columns: (0..self.frequency_hz.len()).map(valid).collect(),
            features,
        })
    }
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
