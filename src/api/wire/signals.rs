//! Channels, waveforms, spectra, scalograms and trends as JSON, in columns.

use super::names::DetectorName;
use super::{KindName, TierName, finite, rfc3339};
use crate::ingest::live::intake::ChannelStatus;
use crate::ingest::live::ledger::Ledger;
use crate::signal::Timestamp;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Whether the samples behind a value can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Validity {
    /// All samples asked for, none clipped, the source delivers or came to its end.
    Ok,
    /// Fewer samples than asked for, because of a gap or because no more are held.
    Gap,
    /// Some samples lie at the ends of the source's number range.
    Clipped,
    /// The source failed: there are newer samples that nobody received.
    Stale,
}

/// Channels of a machine's stream.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct ChannelListWire {
    /// In the order of the stream; empty until the source is open.
    pub items: Vec<ChannelWire>,
}

/// One channel.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct ChannelWire {
    /// Name.
    pub name: String,
    /// Unit of its samples.
    pub unit: String,
    /// Samples a second, Hz.
    pub sample_rate_hz: Option<f64>,
    /// Constant left out of samples sent: physical = value + offset.
    pub offset: Option<f64>,
    /// Kind of the machine's sensor that reads it; null: no sensor names it.
    pub sensor: Option<String>,
    /// Unit of the data and that of the machine file, where they differ; the latter is used.
    pub unit_conflict: Option<[String; 2]>,
    /// Oldest sample held.
    pub oldest_sample: u64,
    /// One past the newest sample.
    pub end_sample: u64,
    /// Stream time one past the newest sample, s.
    pub end_time_s: Option<f64>,
    /// Samples received and kept.
    pub received: u64,
    /// Samples never received: sizes of gaps.
    pub missing: u64,
    /// Number of gaps.
    pub gaps: u64,
    /// Samples received again or too late, and not used.
    pub duplicated: u64,
    /// Samples at the ends of the source's number range.
    pub clipped: u64,
    /// What became of the samples of a live sender; null for other sources.
    pub ledger: Option<LedgerWire>,
}

/// What became of every sample of a channel, in counts since the start of the daemon: received = used + late +
/// duplicate + not_finite + out_of_range + dropped.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct LedgerWire {
    /// Samples that came, in frames without an error.
    pub received: u64,
    /// Samples handed on to the analysis.
    pub used: u64,
    /// Samples that came after later ones; counted in `lost` too.
    pub late: u64,
    /// Samples that had come before.
    pub duplicate: u64,
    /// Samples that are no finite numbers.
    pub not_finite: u64,
    /// Samples beyond the range of the converter.
    pub out_of_range: u64,
    /// Samples without room, of a sender that sent more than it had credit for.
    pub dropped: u64,
    /// Samples that had not come when later ones did.
    pub lost: u64,
    /// Times that samples were lost.
    pub gaps: u64,
    /// Of the samples used, those at the ends of the converter's range.
    pub clipped: u64,
    /// Blocks that came.
    pub blocks: u64,
    /// Blocks that had not come when later ones did.
    pub blocks_lost: u64,
    /// When counting began, RFC 3339: at the channel's first hello since the start of the daemon. A restart counts from 0 again.
    pub counted_since: String,
    /// How much more samples a second of the wall clock come than stated, parts in a million; null: too little is known.
    pub clock_drift_ppm: Option<f64>,
    /// How far the sender's clock is behind that of the daemon by the times it states, delays of the way included, s, below 0:
    /// ahead; null: it states none, or for less than a minute.
    pub clock_offset_s: Option<f64>,
    /// Samples a second by the wall clock.
    pub measured_rate_hz: Option<f64>,
    /// What is wrong with what comes: a rate that is off by more than clocks drift, a clock that is off by more than 10 s (1 s ahead),
    /// or samples that had all come before.
    pub warning: Option<String>,
    /// Where it is sent from at the moment; null: nobody sends it.
    pub sender: Option<String>,
    /// Since when.
    pub sender_since: Option<String>,
}

impl LedgerWire {
    /// Makes it of a channel's status.
    #[must_use]
    pub fn new(status: &ChannelStatus) -> Self {
        let clock = status.clock;
        let (sender, since) = status.sender.clone().unzip();
        let at = |time: Timestamp| rfc3339(Some(time), 0.0);
        // Every count there is, each named once.
        macro_rules! with_counts {
            ($($count:ident),*) => {{
                let Ledger { $($count),* } = status.ledger;
                Self {
                    $($count,)*
                    counted_since: at(status.counted_since),
                    clock_drift_ppm: clock.and_then(|clock| finite(clock.ppm)),
                    clock_offset_s: status.offset_s.and_then(finite),
                    measured_rate_hz: clock.and_then(|clock| finite(clock.rate_hz(status.rate_hz))),
                    warning: status.doubt.clone(),
                    sender,
                    sender_since: since.map(at),
                }
            }};
        }
        with_counts!(
            received,
            used,
            late,
            duplicate,
            not_finite,
            out_of_range,
            dropped,
            lost,
            gaps,
            clipped,
            blocks,
            blocks_lost
        )
    }
}

/// Raw samples of one channel.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct WaveformWire {
    /// Channel.
    pub channel: String,
    /// Unit of `value`.
    pub unit: String,
    /// Samples a second, Hz.
    pub sample_rate_hz: Option<f64>,
    /// Constant left out of `value`: physical = value + offset.
    pub offset: Option<f64>,
    /// First sample used.
    pub start_sample: u64,
    /// Number of samples used.
    pub n_samples: usize,
    /// Whether they can be trusted.
    pub validity: Validity,
    /// Whether `value` holds smallest and largest sample of each stretch instead of all samples.
    pub decimated: bool,
    /// Stream time, s.
    pub time_s: Vec<Option<f64>>,
    /// Samples.
    pub value: Vec<Option<f64>>,
}

/// Which spectrum.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum SpectrumKind {
    /// Amplitude, Hann.
    #[default]
    Amplitude,
    /// One-sided power spectral density by Welch's method, unit²/Hz.
    Psd,
    /// Amplitude of the squared envelope of a band divided by its mean: modulation depth.
    Envelope,
    /// Amplitude √(x² + y²) of a sensor pair, bin by bin.
    Absolute,
    /// Amplitude over orders of the shaft, Hann: resampled to equal angles.
    Order,
    /// Power cepstrum: families of lines by their spacing.
    Cepstrum,
}

/// Where the angle of a shaft comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum AngleFrom {
    /// A tacho with one pulse a revolution of this shaft: 0° is its mark.
    Mark,
    /// A tacho: 0° is one of its pulses, or of those of a shaft that turns in proportion.
    Tacho,
    /// The speed, taken as constant: 0° means nothing.
    Speed,
}

/// A spectrum.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct SpectrumWire {
    /// Channel, or `x+y` for a pair.
    pub channel: String,
    /// Kind.
    pub kind: SpectrumKind,
    /// Detector of `value`; null for a density and a cepstrum.
    pub detector: Option<DetectorName>,
    /// Unit of `value`.
    pub unit: String,
    /// Width by which two lines must differ to be told apart: 1/(window length), Hz.
    pub resolution_hz: Option<f64>,
    /// Distance of two values of `frequency_hz` before thinning, Hz; null for a cepstrum.
    pub bin_width_hz: Option<f64>,
    /// Window function.
    pub window: String,
    /// Number of windows averaged.
    pub averages: usize,
    /// Band that is shown, or demodulated for `envelope`, Hz.
    pub band_hz: [Option<f64>; 2],
    /// First sample used.
    pub start_sample: u64,
    /// Number of samples used.
    pub n_samples: usize,
    /// Whether they can be trusted.
    pub validity: Validity,
    /// Whether each value is the largest of several bins.
    pub decimated: bool,
    /// Frequencies, Hz; of orders at the mean speed, of quefrencies the spacing of lines that they stand for.
    pub frequency_hz: Vec<Option<f64>>,
    /// Of `order`: the orders.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub order: Option<Vec<Option<f64>>>,
    /// Of `cepstrum`: the quefrencies, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quefrency_s: Option<Vec<Option<f64>>>,
    /// Of `order`: mean speed of the shaft, Hz.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shaft_speed_hz: Option<f64>,
    /// Of `order`: where the angle comes from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_from: Option<AngleFrom>,
    /// Values.
    pub value: Vec<Option<f64>>,
}

/// A scalogram and the newest CWT features.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct ScalogramWire {
    /// Channel.
    pub channel: String,
    /// Unit of `magnitude`.
    pub unit: String,
    /// The wavelet.
    pub wavelet: String,
    /// Centre frequency of the wavelet, rad: where its transform is largest.
    pub omega0_rad: f64,
    /// First sample used.
    pub start_sample: u64,
    /// Number of samples used.
    pub n_samples: usize,
    /// Whether they can be trusted.
    pub validity: Validity,
    /// Rows: frequencies, Hz, rising in equal ratios.
    pub frequency_hz: Vec<Option<f64>>,
    /// Columns: start of each stretch of stream time, s.
    pub time_s: Vec<Option<f64>>,
    /// Of whole revolutions: the angle of the shaft at each column, degrees from the first on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_deg: Option<Vec<Option<f64>>>,
    /// Of whole revolutions: where the angle comes from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_from: Option<AngleFrom>,
    /// Of whole revolutions: the shaft.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shaft: Option<String>,
    /// Of whole revolutions: its mean speed, Hz.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shaft_speed_hz: Option<f64>,
    /// Largest |W| of each stretch, zero-to-peak, one array a frequency.
    pub magnitude: Vec<Vec<Option<f64>>>,
    /// First column and one past the last outside the cone of influence, one pair a frequency; what
    /// lies outside holds the ends of the record.
    pub valid_columns: Vec<[usize; 2]>,
    /// CWT features of the newest analysis window, ratios to a baseline among them.
    pub features: Vec<FeatureWire>,
}

/// One named number.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct FeatureWire {
    /// Name.
    pub name: String,
    /// Value.
    pub value: Option<f64>,
    /// Unit.
    pub unit: String,
    /// First sample and one past the last.
    pub sample_range: [u64; 2],
}

/// Features over time.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct TrendWire {
    /// Channel.
    pub channel: String,
    /// What the points are.
    #[serde(flatten)]
    pub points: TrendPointsWire,
}

/// Verdicts on a component over time.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct ComponentTrendWire {
    /// Component's kind.
    pub kind: KindName,
    /// Component's id.
    pub component: String,
    /// What the points are. Features are `state` (1 healthy, 2 warning, 3 damaged), `severity` and
    /// `confidence`; null where it was not judged.
    #[serde(flatten)]
    pub points: TrendPointsWire,
}

/// The points of a trend.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct TrendPointsWire {
    /// Whether what it rests on can be trusted, the worst: `stale`, it reaches to the newest window and no more samples come; `clipped`,
    /// the sensor is found clipped in the newest window; `gap`, stretches without points, or none at all. A window itself never spans a gap.
    pub validity: Validity,
    /// Whether each column holds smallest and largest value of each stretch.
    pub decimated: bool,
    /// Number of windows, minutes or hours there are.
    pub n_windows: usize,
    /// `raw` (every window), `1min` or `1h`.
    pub tier: TierName,
    /// UTC of time 0 (RFC 3339); null: unknown, times of stored points count from 1970-01-01.
    pub start_time: Option<String>,
    /// Stretches without points, first and last time, s. In the columns each is a point without a value.
    pub gaps: Vec<[Option<f64>; 2]>,
    /// Parts that are missing because their file cannot be read, with the reason.
    pub unreadable: Vec<String>,
    /// One entry a feature.
    pub features: Vec<TrendColumnWire>,
}

/// One feature over time.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct TrendColumnWire {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Window ends, or starts of minutes or hours, s of stream time.
    pub time_s: Vec<Option<f64>>,
    /// Values; of minutes and hours their means.
    pub value: Vec<Option<f64>>,
    /// Smallest value of each minute or hour; empty for windows.
    pub low: Vec<Option<f64>>,
    /// Largest value of each minute or hour; empty for windows.
    pub high: Vec<Option<f64>>,
    /// How many windows each value rests on: 1, or those of the minute or hour; 0 where there is no value.
    pub windows: Vec<usize>,
    /// Samples of each window that a value rests on; null where there is no value, and of windows of an earlier stream, whose rate is
    /// not known. Empty for minutes and hours, whose windows may overlap, and for components, whose verdicts rest on several channels.
    pub n_samples: Vec<Option<u64>>,
}
