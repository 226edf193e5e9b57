//! Bilinear time-frequency distributions on demand.

use super::error::ApiError;
use super::extract::{Path, Query, State, in_range};
use super::signals::{Run, fetch, samples_in};
use super::state::{ApiState, channel, newest};
use super::wire::joint::{JointKind, JointWire};
use super::wire::problem::ProblemWire;
use super::wire::{finite, finite_column};
use crate::dsp::bilinear::kernel::Kernel;
use crate::dsp::bilinear::{JointPlan, JointSpec};
use crate::dsp::fft::{FftCache, ForwardPlan, fast_len_at_least};
use crate::signal::ChannelInfo;
use axum::Json;
use rustfft::num_complex::Complex;
use serde::Deserialize;
use utoipa::IntoParams;

/// Most samples of a record, and largest lag step: bound the work of an answer to about a second.
const MAX_RECORD: usize = 16_384;
const MAX_LAGS: usize = 2048;

/// Most samples times lag steps of Choi and Williams, each of which is a convolution.
const MAX_CONVOLVED: usize = 1 << 23;

/// Shortest record worth a distribution, samples.
const MIN_RECORD: usize = 16;

/// Which distribution.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct JointQuery {
    /// Kind.
    #[serde(default)]
    #[param(inline)]
    kind: JointKind,
    /// Length analysed, s; by default 0.2, and at most 16,384 samples.
    #[param(minimum = 0.001, maximum = 60.0)]
    window_s: Option<f64>,
    /// One past the last sample; the newest by default.
    end: Option<u64>,
    /// Not for `wigner_ville`: half width of the window over lags, s; by default an eighth of the record. Lags are at most 4096
    /// samples.
    #[param(minimum = 0.0, maximum = 60.0)]
    lag_s: Option<f64>,
    /// Only for `smoothed_pseudo_wigner_ville`: half width of the window over time, s; by default a 32nd of the record.
    #[param(minimum = 0.0, maximum = 60.0)]
    smoothing_s: Option<f64>,
    /// Only for `choi_williams`: σ; smaller suppresses cross terms more and blurs more.
    #[param(minimum = 0.001, maximum = 1_000_000.0, default = 1.0)]
    sigma: Option<f64>,
    /// Lowest frequency shown, Hz.
    min_hz: Option<f64>,
    /// Highest frequency shown, Hz.
    max_hz: Option<f64>,
    /// At most this many frequencies.
    #[param(minimum = 2, maximum = 1024, default = 256)]
    n_frequencies: Option<usize>,
    /// Instants.
    #[param(minimum = 2, maximum = 512, default = 200)]
    n_times: Option<usize>,
}

/// Gives a Wigner–Ville distribution of the newest samples of a channel, plain or smoothed.
///
/// Sharper than any window or wavelet, but two lines leave a third term between them, which beats at their difference and
/// may be negative; the smoothed kinds suppress it.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/channels/{name}/joint",
    tag = "signals",
    params(
        ("id" = String, Path, description = "Machine id"),
        ("name" = String, Path, description = "Channel name"),
        JointQuery,
    ),
    responses(
        (status = OK, body = JointWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Other spectra are being computed; see Retry-After"),
    )
)]
pub(super) async fn joint(
    State(state): State<ApiState>,
    Path((id, name)): Path<(String, String)>,
    Query(query): Query<JointQuery>,
) -> Result<Json<JointWire>, ApiError> {
    let view = newest(state.machine(&id)?);
    let (_, info) = channel(&view, &name)?;
    let request = JointRequest::new(&query, info)?;
    let run = fetch(&state, &id, &name, query.end, request.n_record).await?;
    let wire = state.compute(move || request.compute(name, &run)).await?;
    Ok(Json(wire))
}

/// A checked request.
#[derive(Debug)]
struct JointRequest {
    kind: JointKind,
    n_record: usize,
    lag_s: Option<f64>,
    smoothing_s: Option<f64>,
    sigma: f64,
    shown_hz: (f64, f64),
    n_frequencies: usize,
    n_times: usize,
}

impl JointRequest {
    fn new(query: &JointQuery, info: &ChannelInfo) -> Result<Self, ApiError> {
        let (kind, fs_hz) = (query.kind, info.sample_rate.0);
        refuse_strangers(query)?;
        let usual_s = 0.2_f64.min(MAX_RECORD as f64 / fs_hz).max(0.001);
        let window_s = in_range("window_s", query.window_s, usual_s, 0.001, 60.0)?;
        let n_record = samples_in(info, window_s);
        if !(MIN_RECORD..=MAX_RECORD).contains(&n_record) {
            return Err(ApiError::Invalid(format!(
                "window_s is {window_s}, which is {n_record} samples of this channel, allowed are {MIN_RECORD} to \
                 {MAX_RECORD}"
            )));
        }
        let nyquist_hz = 0.5 * fs_hz;
        let shown_hz = (
            in_range("min_hz", query.min_hz, 0.0, 0.0, nyquist_hz)?,
            in_range("max_hz", query.max_hz, nyquist_hz, 0.0, nyquist_hz)?,
        );
        if shown_hz.0 >= shown_hz.1 {
            return Err(ApiError::Invalid("min_hz must lie below max_hz".to_owned()));
        }
        let checked = |name, value: Option<f64>| match value {
            Some(_) => in_range(name, value, 0.0, 0.0, 60.0).map(Some),
            None => Ok(None),
        };
        Ok(Self {
            kind,
            n_record,
            lag_s: checked("lag_s", query.lag_s)?,
            smoothing_s: checked("smoothing_s", query.smoothing_s)?,
            sigma: in_range("sigma", query.sigma, 1.0, 1e-3, 1e6)?,
            shown_hz,
            n_frequencies: in_range("n_frequencies", query.n_frequencies, 256, 2, 1024)?,
            n_times: in_range("n_times", query.n_times, 200, 2, 512)?,
        })
    }

    /// Of a record of `n` samples, which may be fewer than asked for.
    fn spec(&self, n: usize, info: &ChannelInfo) -> Result<JointSpec, ApiError> {
        let most = (n - 1) / 2;
        let is_whole = self.kind == JointKind::WignerVille;
        let wanted = match self.lag_s {
            Some(lag_s) => samples_in(info, lag_s).div_ceil(2),
            None if is_whole => most,
            None => (n / 16).min(MAX_LAGS),
        };
        let n_lags = wanted.clamp(1, most);
        if n_lags > MAX_LAGS {
            return Err(ApiError::Invalid(format!(
                "the lags reach {} samples, allowed are {}; ask for a smaller {}",
                2 * n_lags,
                2 * MAX_LAGS,
                if is_whole { "window_s" } else { "lag_s" }
            )));
        }
        let kernel = match self.kind {
            JointKind::WignerVille | JointKind::PseudoWignerVille => Kernel::Delta,
            JointKind::SmoothedPseudoWignerVille => {
                let wanted = self.smoothing_s.map_or(n / 32, |s| samples_in(info, s));
                Kernel::Hann(wanted.min(n / 2))
            }
            JointKind::ChoiWilliams => Kernel::ChoiWilliams(self.sigma),
        };
        if self.kind == JointKind::ChoiWilliams && n * n_lags > MAX_CONVOLVED {
            return Err(ApiError::Invalid(format!(
                "{n} samples times {n_lags} lag steps, allowed are {MAX_CONVOLVED}; ask for a smaller window_s or lag_s"
            )));
        }
        let n_times = self.n_times.min(n);
        let is_lag_windowed = !is_whole;
        let n_frequencies = fast_len_at_least(2 * n_lags + 1);
        Ok(JointSpec { kernel, n_lags, is_lag_windowed, n_frequencies, n_times })
    }

    fn compute(&self, channel: String, run: &Run) -> Result<JointWire, ApiError> {
        let Run { info, waveform, validity } = run;
        let (samples, fs_hz) = (&waveform.samples[..], info.sample_rate.0);
        let n = samples.len();
        let few = || {
            ApiError::NotFound(format!(
                "only {n} contiguous samples of {channel:?} are held, {MIN_RECORD} are needed"
            ))
        };
        if n < MIN_RECORD {
            return Err(few());
        }
        let spec = self.spec(n, info)?;
        let mut cache = FftCache::<f32>::new();
        let mut forward = ForwardPlan::new(n, &mut cache);
        let mut x_hat = vec![Complex::new(0.0, 0.0); forward.n_bins()];
        forward.process(samples, &mut x_hat);
        let mut plan = JointPlan::new(n, fs_hz, spec, &mut cache).ok_or_else(few)?;
        let mut density = vec![0.0_f32; plan.out_len()];
        plan.process(&x_hat, &mut density);
        let width_hz = plan.bin_width_hz();
        let (low_hz, high_hz) = self.shown_hz;
        let shown: Vec<usize> = (0..spec.n_frequencies)
            .filter(|k| (low_hz..=high_hz).contains(&(*k as f64 * width_hz)))
            .collect();
        if shown.is_empty() {
            return Err(ApiError::Invalid(format!(
                "no frequency lies between min_hz and max_hz: they are {width_hz} Hz apart; ask for a longer lag_s"
            )));
        }
        let per_row = shown.len().div_ceil(self.n_frequencies);
        let rows: Vec<&[usize]> = shown.chunks(per_row).collect();
        let value = |bins: &&[usize]| {
            let of_instant = |density: &[f32]| {
                let larger = |a: f32, k: &usize| {
                    if density[*k].abs() > a.abs() { density[*k] } else { a }
                };
                f64::from(bins.iter().fold(0.0, larger))
            };
            finite_column(density.chunks(spec.n_frequencies).map(of_instant))
        };
        let middle = |bins: &&[usize]| {
            let ends = bins.first().zip(bins.last());
            ends.map_or(f64::NAN, |(a, b)| 0.5 * (a + b) as f64 * width_hz)
        };
        let seconds = |samples: usize| samples as f64 / fs_hz;
        let smoothing_s = match spec.kernel {
            Kernel::Hann(half) => Some(seconds(half)),
            Kernel::Delta | Kernel::ChoiWilliams(_) => None,
        };
        let time_s = |t: &usize| waveform.start_time_s + seconds(*t);
        Ok(JointWire {
            channel,
            kind: self.kind,
            unit: format!("({})^2/Hz", info.unit.symbol()),
            lag_s: finite(seconds(2 * spec.n_lags)),
            smoothing_s,
            sigma: (self.kind == JointKind::ChoiWilliams).then_some(self.sigma),
            start_sample: waveform.start,
            n_samples: n,
            validity: *validity,
            bin_width_hz: finite(width_hz),
            decimated: per_row > 1,
            frequency_hz: finite_column(rows.iter().map(middle)),
            time_s: finite_column(plan.instants().iter().map(time_s)),
            value: rows.iter().map(value).collect(),
        })
    }
}

/// Refuses parameters that the kind does not have.
fn refuse_strangers(query: &JointQuery) -> Result<(), ApiError> {
    let strangers = [
        (
            query.kind == JointKind::WignerVille && query.lag_s.is_some(),
            "lag_s is not allowed here: wigner_ville has every lag",
        ),
        (
            query.kind != JointKind::SmoothedPseudoWignerVille && query.smoothing_s.is_some(),
            "smoothing_s is not allowed here: it belongs to kind=smoothed_pseudo_wigner_ville",
        ),
        (
            query.kind != JointKind::ChoiWilliams && query.sigma.is_some(),
            "sigma is not allowed here: it belongs to kind=choi_williams",
        ),
    ];
    match strangers.iter().find(|(is_strange, _)| *is_strange) {
        Some((_, why)) => Err(ApiError::Invalid((*why).to_owned())),
        None => Ok(()),
    }
}
