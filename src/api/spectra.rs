//! Spectra on demand: from a copied slice, beside the event loop.

use super::error::ApiError;
use super::extract::{Path, Query, State, in_range};
use super::signals::{MAX_POINTS, MAX_SAMPLES, Run, fetch, samples_in};
use super::state::{ApiState, channel, newest};
use super::wire::problem::ProblemWire;
use super::wire::signals::{SpectrumKind, SpectrumWire, Validity};
use super::wire::{DetectorName, finite, finite_column};
use crate::diagnosis::fault::Detector;
use crate::dsp::absolute::absolute_vibration;
use crate::dsp::envelope::{EnvelopeSpectrumPlan, SquaredEnvelopePlan, bins_of_band};
use crate::dsp::fft::{FftCache, ForwardPlan, n_bins};
use crate::dsp::spectrum::AmplitudePlan;
use crate::dsp::welch::WelchPlan;
use crate::machine::Machine;
use crate::machine::sensor::Sensor;
use crate::plot::decimate;
use crate::signal::ChannelInfo;
use axum::Json;
use rustfft::num_complex::Complex;
use serde::Deserialize;
use utoipa::IntoParams;

/// Longest window, samples.
pub(super) const MAX_WINDOW_SAMPLES: usize = 2_097_152;

/// Shortest window worth a spectrum, samples.
pub(super) const MIN_WINDOW_SAMPLES: usize = 16;

/// Most windows averaged.
const MAX_AVERAGES: usize = 64;

/// Which spectrum, of what.
#[derive(Debug, Clone, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct SpectrumQuery {
    /// Kind.
    #[serde(default)]
    #[param(inline)]
    kind: SpectrumKind,
    /// How amplitudes are given; zero-to-peak by default. Not for `psd`.
    detector: Option<DetectorName>,
    /// Length of a window, s; the resolution is its reciprocal.
    #[param(minimum = 0.001, maximum = 120.0, default = 4.0)]
    window_s: Option<f64>,
    /// Windows averaged (power mean, 50 % overlap); 1 by default, 8 for `psd`.
    #[param(minimum = 1, maximum = 64)]
    averages: Option<usize>,
    /// Envelope only: lower end of the band demodulated, Hz; by default from fs/8 to 0.45·fs,
    /// inside the sensor's usable band.
    band_low_hz: Option<f64>,
    /// Envelope only: upper end of the band demodulated, Hz.
    band_high_hz: Option<f64>,
    /// Absolute only: the other channel of the pair; by default the sensor 90° from this one.
    with: Option<String>,
    /// One past the last sample; the newest by default.
    end: Option<u64>,
    /// Lowest frequency shown, Hz.
    min_hz: Option<f64>,
    /// Highest frequency shown, Hz.
    max_hz: Option<f64>,
    /// At most this many values, the largest of each stretch.
    #[param(minimum = 2, maximum = 200_000, default = 4096)]
    max_points: Option<usize>,
}

/// Gives a spectrum of the newest samples of a channel.
///
/// A line between two bins reads up to 15 % low (Hann); evidence of a diagnosis is read at the exact
/// frequency instead. `cepstrum` and `order` are not part of this version.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/channels/{name}/spectrum",
    tag = "signals",
    params(
        ("id" = String, Path, description = "Machine id"),
        ("name" = String, Path, description = "Channel name"),
        SpectrumQuery,
    ),
    responses(
        (status = OK, body = SpectrumWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Other spectra are being computed; see Retry-After"),
    )
)]
pub(super) async fn spectrum(
    State(state): State<ApiState>,
    Path((id, name)): Path<(String, String)>,
    Query(query): Query<SpectrumQuery>,
) -> Result<Json<SpectrumWire>, ApiError> {
    let handle = state.machine(&id)?;
    let view = newest(handle);
    let (_, info) = channel(&view, &name)?;
    let sensor = view.machine.sensors.iter().find(|sensor| sensor.channel == name);
    let request = SpectrumRequest::new(&query, info, sensor)?;
    let run = fetch(&state, &id, &name, query.end, request.n_wanted()).await?;
    let other = match query.kind {
        SpectrumKind::Absolute => {
            let other = match query.with.as_deref() {
                Some(other) => other,
                None => partner(&view.machine, &name)?,
            };
            channel(&view, other)?;
            // The same samples of both: the shorter end of the two decides.
            let end = run.waveform.start + run.waveform.samples.len() as u64;
            Some((
                other.to_owned(),
                fetch(&state, &id, other, Some(end), run.waveform.samples.len()).await?,
            ))
        }
        SpectrumKind::Amplitude | SpectrumKind::Psd | SpectrumKind::Envelope => None,
    };
    let wire = state.compute(move || request.compute(&name, run, other)).await?;
    Ok(Json(wire))
}

/// A checked request.
#[derive(Debug, Clone)]
struct SpectrumRequest {
    kind: SpectrumKind,
    detector: Detector,
    fs_hz: f64,
    n_window: usize,
    averages: usize,
    /// Demodulated, for envelopes.
    band_hz: (f64, f64),
    shown_hz: (f64, f64),
    max_points: usize,
}

/// Bins of a spectrum.
struct Bins {
    value: Vec<f32>,
    width_hz: f64,
    averages: usize,
    n_window: usize,
}

impl SpectrumRequest {
    fn new(
        query: &SpectrumQuery,
        info: &ChannelInfo,
        sensor: Option<&Sensor>,
    ) -> Result<Self, ApiError> {
        let kind = query.kind;
        let fs_hz = info.sample_rate.0;
        refuse_strangers(query)?;
        let window_s = in_range("window_s", query.window_s, 4.0, 0.001, 120.0)?;
        let n_window = samples_in(info, window_s);
        if !(MIN_WINDOW_SAMPLES..=MAX_WINDOW_SAMPLES).contains(&n_window) {
            return Err(ApiError::Invalid(format!(
                "window_s is {window_s}, which is {n_window} samples of this channel, allowed are \
                 {MIN_WINDOW_SAMPLES} to {MAX_WINDOW_SAMPLES}"
            )));
        }
        let usual = if kind == SpectrumKind::Psd { 8 } else { 1 };
        let averages = in_range("averages", query.averages, usual, 1, MAX_AVERAGES)?;
        let n_wanted = samples_of(n_window, averages);
        if n_wanted > MAX_SAMPLES {
            return Err(ApiError::Invalid(format!(
                "averages is {averages}, which takes {n_wanted} samples, allowed are {MAX_SAMPLES}"
            )));
        }
        let nyquist_hz = fs_hz / 2.0;
        let shown_hz = (
            in_range("min_hz", query.min_hz, 0.0, 0.0, nyquist_hz)?,
            in_range("max_hz", query.max_hz, nyquist_hz, 0.0, nyquist_hz)?,
        );
        if shown_hz.0 >= shown_hz.1 {
            return Err(ApiError::Invalid("min_hz must lie below max_hz".to_owned()));
        }
        let usable = sensor.and_then(|sensor| sensor.usable);
        let (usable_low, usable_high) = usable.map_or((0.0, nyquist_hz), |(l, h)| (l.0, h.0));
        let band_hz = (
            query.band_low_hz.unwrap_or((fs_hz / 8.0).max(usable_low).min(usable_high / 2.0)),
            query.band_high_hz.unwrap_or((0.45 * fs_hz).min(usable_high)),
        );
        let band_is_sound = 0.0 <= band_hz.0 && band_hz.0 < band_hz.1 && band_hz.1 <= nyquist_hz;
        if kind == SpectrumKind::Envelope && !band_is_sound {
            return Err(ApiError::Invalid(format!(
                "the band is {} to {} Hz, allowed is 0 ≤ band_low_hz < band_high_hz ≤ {nyquist_hz}",
                band_hz.0, band_hz.1
            )));
        }
        Ok(Self {
            kind,
            detector: query.detector.map_or(Detector::ZeroToPeak, Into::into),
            fs_hz,
            n_window,
            averages,
            band_hz,
            shown_hz,
            max_points: in_range("max_points", query.max_points, 4096, 2, MAX_POINTS)?,
        })
    }

    fn n_wanted(&self) -> usize {
        samples_of(self.n_window, self.averages)
    }

    fn compute(
        &self,
        name: &str,
        run: Run,
        other: Option<(String, Run)>,
    ) -> Result<SpectrumWire, ApiError> {
        let Run { info, mut waveform, mut validity } = run;
        let mut channel = name.to_owned();
        if let Some((other_name, other)) = other {
            channel = format!("{name}+{other_name}");
            let start = absolute(&mut waveform.samples, waveform.start, &info, &other)?;
            waveform.start = start;
            validity = worse(validity, other.validity);
        }
        let samples = &waveform.samples[..];
        if samples.len() < MIN_WINDOW_SAMPLES {
            return Err(ApiError::NotFound(format!(
                "only {} contiguous samples of {channel:?} are held, {MIN_WINDOW_SAMPLES} are needed",
                samples.len()
            )));
        }
        if samples.len() < self.n_window && waveform.start > 0 {
            validity = worse(validity, Validity::Gap);
        }
        let bins = self.bins(samples)?;
        Ok(self.wire(channel, &info, waveform.start, samples.len(), validity, &bins))
    }

    fn bins(&self, samples: &[f32]) -> Result<Bins, ApiError> {
        let n_window = self.n_window.min(samples.len());
        let mut cache = FftCache::new();
        let (value, averages, width_hz) = match self.kind {
            SpectrumKind::Psd => {
                let mut plan = WelchPlan::new(n_window, &mut cache);
                let mut density = vec![0.0; plan.n_bins()];
                let averages = plan.process(samples, self.fs_hz, &mut density);
                (density, averages, self.fs_hz / n_window as f64)
            }
            SpectrumKind::Amplitude | SpectrumKind::Absolute => {
                let mut plan = AmplitudePlan::new(n_window, &mut cache);
                let n_bins = plan.n_bins();
                let (mean, averages) = power_mean(samples, n_window, n_bins, |window, out| {
                    plan.process(window, out);
                });
                (mean, averages, plan.bin_width_hz(self.fs_hz))
            }
            SpectrumKind::Envelope => return self.envelope_bins(samples, n_window, &mut cache),
        };
        Ok(Bins { value, width_hz, averages, n_window })
    }

    fn envelope_bins(
        &self,
        samples: &[f32],
        n_window: usize,
        cache: &mut FftCache<f32>,
    ) -> Result<Bins, ApiError> {
        let (low_hz, high_hz) = self.band_hz;
        let band = bins_of_band(n_window, self.fs_hz, low_hz, high_hz).ok_or_else(|| {
            ApiError::Invalid(format!(
                "the band {low_hz} to {high_hz} Hz holds no bin of a window of {n_window} samples"
            ))
        })?;
        let mut forward = ForwardPlan::new(n_window, cache);
        let mut squared = SquaredEnvelopePlan::new(n_window, band, cache);
        let mut spectrum = EnvelopeSpectrumPlan::new(squared.out_len(), cache);
        let mut x_hat = vec![Complex::new(0.0, 0.0); n_bins(n_window)];
        let mut e2 = vec![0.0; squared.out_len()];
        let n_depths = spectrum.n_bins();
        let (value, averages) = power_mean(samples, n_window, n_depths, |window, depth| {
            forward.process(window, &mut x_hat);
            squared.process(&x_hat, &mut e2);
            // No signal, nothing modulated: the depths are 0 then.
            let _mean = spectrum.process(&e2, depth);
        });
        let width_hz = spectrum.bin_width_hz(squared.out_rate_hz(self.fs_hz));
        Ok(Bins { value, width_hz, averages, n_window })
    }

    fn wire(
        &self,
        channel: String,
        info: &ChannelInfo,
        start_sample: u64,
        n_samples: usize,
        validity: Validity,
        bins: &Bins,
    ) -> SpectrumWire {
        let frequency_hz = |k: usize| k as f64 * bins.width_hz;
        let (low_hz, high_hz) = self.shown_hz;
        // Half a bin of tolerance: a border meant to be on a bin must not miss it by rounding.
        let slack_hz = 1e-6 * bins.width_hz;
        let shown: Vec<usize> = (0..bins.value.len())
            .filter(|k| (low_hz - slack_hz..=high_hz + slack_hz).contains(&frequency_hz(*k)))
            .collect();
        let kept =
            decimate::peaks(shown.len(), self.max_points, |i| f64::from(bins.value[shown[i]]));
        let factor = match self.detector {
            Detector::Rms => std::f64::consts::FRAC_1_SQRT_2,
            Detector::ZeroToPeak => 1.0,
            Detector::PeakToPeak => 2.0,
        };
        let is_density = self.kind == SpectrumKind::Psd;
        let unit = match self.kind {
            SpectrumKind::Amplitude | SpectrumKind::Absolute => info.unit.symbol().to_owned(),
            SpectrumKind::Psd => format!("({})^2/Hz", info.unit.symbol()),
            SpectrumKind::Envelope => "1".to_owned(),
        };
        let band_hz =
            if self.kind == SpectrumKind::Envelope { self.band_hz } else { self.shown_hz };
        SpectrumWire {
            channel,
            kind: self.kind,
            detector: (!is_density).then_some(self.detector.into()),
            unit,
            resolution_hz: finite(self.fs_hz / bins.n_window as f64),
            bin_width_hz: finite(bins.width_hz),
            window: "hann".to_owned(),
            averages: bins.averages,
            band_hz: [finite(band_hz.0), finite(band_hz.1)],
            start_sample,
            n_samples,
            validity,
            decimated: kept.len() < shown.len(),
            frequency_hz: finite_column(kept.iter().map(|i| frequency_hz(shown[*i]))),
            value: finite_column(kept.iter().map(|i| f64::from(bins.value[shown[*i]]) * factor)),
        }
    }
}

/// Samples of `averages` windows, which overlap by half.
fn samples_of(n_window: usize, averages: usize) -> usize {
    n_window + (averages - 1) * (n_window / 2)
}

/// Refuses parameters that the kind does not have.
fn refuse_strangers(query: &SpectrumQuery) -> Result<(), ApiError> {
    let has_band = query.band_low_hz.is_some() || query.band_high_hz.is_some();
    let strangers = [
        (query.kind == SpectrumKind::Psd && query.detector.is_some(), "detector", "psd has none"),
        (
            query.kind != SpectrumKind::Envelope && has_band,
            "band_low_hz and band_high_hz",
            "they belong to kind=envelope; min_hz and max_hz choose what is shown",
        ),
        (
            query.kind != SpectrumKind::Absolute && query.with.is_some(),
            "with",
            "it belongs to kind=absolute",
        ),
    ];
    match strangers.iter().find(|(is_strange, ..)| *is_strange) {
        Some((_, name, why)) => {
            Err(ApiError::Invalid(format!("{name} is not allowed here: {why}")))
        }
        None => Ok(()),
    }
}

/// Power mean √(mean v²) of the spectra of all whole windows, which overlap by half, and their
/// number. `spectrum` writes the `n_bins` values of a window.
fn power_mean(
    samples: &[f32],
    n_window: usize,
    n_bins: usize,
    mut spectrum: impl FnMut(&[f32], &mut [f32]),
) -> (Vec<f32>, usize) {
    let mut value = vec![0.0_f32; n_bins];
    let mut power = vec![0.0_f64; n_bins];
    let mut n_averages = 0_u32;
    for window in samples.windows(n_window).step_by((n_window / 2).max(1)) {
        spectrum(window, &mut value);
        for (power, value) in power.iter_mut().zip(&value) {
            *power += f64::from(*value) * f64::from(*value);
        }
        n_averages += 1;
    }
    let averages = f64::from(n_averages.max(1));
    for (value, power) in value.iter_mut().zip(&power) {
        #[expect(clippy::cast_possible_truncation, reason = "spectra are f32")]
        let mean = (power / averages).sqrt() as f32;
        *value = mean;
    }
    (value, n_averages as usize)
}

/// Turns `x` into the absolute vibration of `x` and `other` over the samples both hold; gives the
/// first of them.
fn absolute(
    x: &mut Vec<f32>,
    start: u64,
    info: &ChannelInfo,
    other: &Run,
) -> Result<u64, ApiError> {
    let y = &other.waveform;
    let same = info.unit == other.info.unit && info.sample_rate == other.info.sample_rate;
    if !same {
        return Err(ApiError::Invalid(
            "the two channels of an absolute vibration need one unit and one rate".to_owned(),
        ));
    }
    let first = start.max(y.start);
    let end = (start + x.len() as u64).min(y.start + y.samples.len() as u64);
    let n = usize::try_from(end.saturating_sub(first)).unwrap_or(0);
    let from = |begin: u64| usize::try_from(first - begin).unwrap_or(usize::MAX);
    let (Some(x_part), Some(y_part)) = (
        x.get(from(start)..).and_then(|x| x.get(..n)),
        y.samples.get(from(y.start)..).and_then(|y| y.get(..n)),
    ) else {
        return Err(ApiError::NotFound("the two channels hold no samples of one time".to_owned()));
    };
    let mut out = vec![0.0; n];
    absolute_vibration(x_part, y_part, &mut out);
    *x = out;
    Ok(first)
}

/// Finds the channel of the sensor that forms a pair with the one of `name`.
fn partner<'m>(machine: &'m Machine, name: &str) -> Result<&'m str, ApiError> {
    let channel = |index: usize| machine.sensors[index].channel.as_str();
    machine
        .sensor_pairs()
        .into_iter()
        .map(|pair| (channel(pair.x), channel(pair.y)))
        .find_map(|(x, y)| if x == name { Some(y) } else { (y == name).then_some(x) })
        .ok_or_else(|| {
            ApiError::Invalid(format!(
                "no sensor of the same kind and place stands 90° ± 5° from {name:?}; name the other \
                 channel by with="
            ))
        })
}

/// The worse of two validities.
fn worse(a: Validity, b: Validity) -> Validity {
    let rank = |validity: Validity| match validity {
        Validity::Ok => 0,
        Validity::Gap => 1,
        Validity::Clipped => 2,
        Validity::Stale => 3,
    };
    if rank(b) > rank(a) { b } else { a }
}
