//! Spectra on demand: from a copied slice, beside the event loop.

use super::bins::{Bins, Wanted, wanted_bins};
use super::error::ApiError;
use super::extract::{Path, Query, State, in_range};
use super::pairs::{fetch_pair, partner, together, worse};
use super::recent::Key;
use super::signals::{MAX_POINTS, MAX_SAMPLES, Run, fetch, samples_in};
use super::state::{ApiState, channel, newest};
use super::turning::{Turner, Watched};
use super::wire::problem::ProblemWire;
use super::wire::signals::{SpectrumKind, SpectrumWire, Validity};
use super::wire::{DetectorName, finite, finite_column};
use crate::diagnosis::fault::Detector;
use crate::dsp::absolute::absolute_vibration;
use crate::machine::sensor::Sensor;
use crate::plot::decimate;
use crate::signal::ChannelInfo;
use axum::Extension;
use axum::body::Bytes;
use axum::http::{HeaderValue, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;

/// Longest window, samples.
pub(super) const MAX_WINDOW_SAMPLES: usize = 2_097_152;

/// Shortest window worth a spectrum, samples.
pub(super) const MIN_WINDOW_SAMPLES: usize = 16;

/// Most windows averaged.
const MAX_AVERAGES: usize = 64;

/// By how much the answer before may be behind while the next one is computed, s.
const MAX_BEHIND_S: f64 = 1.0;

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
/// frequency instead. `order` is resampled to equal angles of the shaft that the sensor listens to, by the tacho if there is one.
/// In a cepstrum a family of lines at one spacing is a peak at the quefrency 1/spacing.
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
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "`order` of a shaft whose speed is not known"),
    )
)]
pub(super) async fn spectrum(
    State(state): State<ApiState>,
    Path((id, name)): Path<(String, String)>,
    Query(query): Query<SpectrumQuery>,
    uri: Uri,
) -> Result<Response, ApiError> {
    let view = newest(state.machine(&id)?);
    let (place, info) = channel(&view, &name)?;
    let received = view.rings.get(place).map_or(0, |ring| ring.received);
    // A pair's other channel comes with this one.
    let behind = samples_in(info, MAX_BEHIND_S) as u64;
    let key = Key { asked: uri.to_string(), received, behind };
    let made = state.recent.answer(key, async {
        let wire = computed(&state, (&id, &name), &query).await?;
        let text = serde_json::to_vec(&wire).map_err(|_| ApiError::Internal)?;
        Ok::<_, ApiError>(Bytes::from(text))
    });
    let json = const { HeaderValue::from_static("application/json") };
    let made = made.await?;
    Ok(([(header::CONTENT_TYPE, json)], Extension(made.tag), made.body).into_response())
}

async fn computed(
    state: &ApiState,
    (id, name): (&str, &str),
    query: &SpectrumQuery,
) -> Result<SpectrumWire, ApiError> {
    let view = newest(state.machine(id)?);
    let (_, info) = channel(&view, name)?;
    let sensor = view.machine.sensors.iter().find(|sensor| sensor.channel == name);
    let request = SpectrumRequest::new(query, info, sensor)?;
    let n_wanted = request.n_wanted();
    let (run, other) = if query.kind == SpectrumKind::Absolute {
        let other = match query.with.as_deref() {
            Some(other) => other,
            None => partner(&view.machine, name, "with")?,
        };
        channel(&view, other)?;
        let (run, its) = fetch_pair(state, id, (name, other), query.end, n_wanted).await?;
        (run, Some((other.to_owned(), its)))
    } else {
        (fetch(state, id, name, query.end, n_wanted).await?, None)
    };
    let watched = if query.kind == SpectrumKind::Order {
        Some(Turner::of_channel(&view, name)?.watch(state, id, &run).await?)
    } else {
        None
    };
    let name = name.to_owned();
    state.compute(move || request.compute(&name, run, other, watched.as_ref())).await
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
        watched: Option<&Watched>,
    ) -> Result<SpectrumWire, ApiError> {
        let mut run = run;
        let mut channel = name.to_owned();
        if let Some((other_name, other)) = other {
            channel = format!("{name}+{other_name}");
            run = absolute(run, &other)?;
        }
        let Run { info, waveform, mut validity } = run;
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
        let wanted = Wanted {
            kind: self.kind,
            fs_hz: self.fs_hz,
            n_window: self.n_window.min(samples.len()),
            band_hz: self.band_hz,
        };
        let turns = watched.map(|watched| watched.turns(waveform.start_time_s)).transpose()?;
        let bins = wanted_bins(&wanted, samples, turns.as_ref())?;
        Ok(self.wire(channel, &info, waveform.start, samples.len(), validity, &bins))
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
        let frequency_hz = |k: usize| bins.axis.frequency_hz(k);
        let (low_hz, high_hz) = self.shown_hz;
        // A border meant to be on a bin must not miss it by rounding.
        let slack_hz = 1e-6 * self.fs_hz / bins.n_window as f64;
        let shown: Vec<usize> = (0..bins.value.len())
            .filter(|k| (low_hz - slack_hz..=high_hz + slack_hz).contains(&frequency_hz(*k)))
            .collect();
        let kept =
            decimate::peaks(shown.len(), self.max_points, |i| f64::from(bins.value[shown[i]]));
        let factor = match self.detector {
            _ if has_none(self.kind) => 1.0,
            Detector::Rms => std::f64::consts::FRAC_1_SQRT_2,
            Detector::ZeroToPeak => 1.0,
            Detector::PeakToPeak => 2.0,
        };
        let has_detector = !has_none(self.kind);
        let unit = match self.kind {
            SpectrumKind::Amplitude | SpectrumKind::Absolute | SpectrumKind::Order => {
                info.unit.symbol().to_owned()
            }
            SpectrumKind::Psd => format!("({})^2/Hz", info.unit.symbol()),
            SpectrumKind::Envelope | SpectrumKind::Cepstrum => "1".to_owned(),
        };
        let band_hz =
            if self.kind == SpectrumKind::Envelope { self.band_hz } else { self.shown_hz };
        SpectrumWire {
            channel,
            kind: self.kind,
            detector: has_detector.then_some(self.detector.into()),
            unit,
            resolution_hz: finite(self.fs_hz / bins.n_window as f64),
            bin_width_hz: bins.axis.width_hz().and_then(finite),
            window: if self.kind == SpectrumKind::Cepstrum { "none" } else { "hann" }.to_owned(),
            averages: bins.averages,
            band_hz: [finite(band_hz.0), finite(band_hz.1)],
            start_sample,
            n_samples,
            validity,
            decimated: kept.len() < shown.len(),
            frequency_hz: finite_column(kept.iter().map(|i| frequency_hz(shown[*i]))),
            order: bins.axis.orders(kept.iter().map(|i| shown[*i])),
            quefrency_s: bins.axis.quefrencies_s(kept.iter().map(|i| shown[*i])),
            shaft_speed_hz: bins.axis.speed_hz().and_then(finite),
            angle_from: bins.angle_from,
            value: finite_column(kept.iter().map(|i| f64::from(bins.value[shown[*i]]) * factor)),
        }
    }
}

/// Samples of `averages` windows, which overlap by half.
fn samples_of(n_window: usize, averages: usize) -> usize {
    n_window + (averages - 1) * (n_window / 2)
}

/// Whether values of this kind are no amplitudes, so that no detector reads them.
fn has_none(kind: SpectrumKind) -> bool {
    matches!(kind, SpectrumKind::Psd | SpectrumKind::Cepstrum)
}

/// Refuses parameters that the kind does not have.
fn refuse_strangers(query: &SpectrumQuery) -> Result<(), ApiError> {
    let has_band = query.band_low_hz.is_some() || query.band_high_hz.is_some();
    let strangers = [
        (
            has_none(query.kind) && query.detector.is_some(),
            "detector",
            "a density and a cepstrum have none",
        ),
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

/// The absolute vibration of `x` and `other` over the samples both hold.
fn absolute(x: Run, other: &Run) -> Result<Run, ApiError> {
    let (first, xs, ys) = together(&x, other)?;
    let mut out = vec![0.0; xs.len()];
    absolute_vibration(xs, ys, &mut out);
    let skipped = (first - x.waveform.start) as f64;
    let validity = worse(x.validity, other.validity);
    let Run { info, mut waveform, .. } = x;
    waveform.start_time_s += skipped / info.sample_rate.0;
    waveform.start = first;
    waveform.samples = out;
    Ok(Run { info, waveform, validity })
}
