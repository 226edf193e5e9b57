//! Wavelets, and bilinear distributions as JSON, in rows.

use super::signals::Validity;
use crate::dsp::wavelet::shape::Wavelet;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Which wavelet.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum WaveletName {
    /// Morlet's, ω₀ = 2π: narrow in frequency.
    #[default]
    Morlet,
    /// Second derivative of a Gaussian: narrow in time.
    MexicanHat,
    /// Difference of two means: steps.
    Haar,
    /// Daubechies', 2 vanishing moments.
    Db2,
    /// Daubechies', 4 vanishing moments.
    Db4,
    /// Daubechies', 6 vanishing moments.
    Db6,
    /// Daubechies', 8 vanishing moments.
    Db8,
    /// Daubechies', 10 vanishing moments.
    Db10,
    /// Biorthogonal spline, 1 vanishing moment, 3 zeros at π.
    #[serde(rename = "bior1.3")]
    Bior13,
    /// Biorthogonal spline, 1 vanishing moment, 5 zeros at π.
    #[serde(rename = "bior1.5")]
    Bior15,
    /// Biorthogonal spline, 2 vanishing moments, 4 zeros at π.
    #[serde(rename = "bior2.4")]
    Bior24,
    /// Biorthogonal spline, 2 vanishing moments, 8 zeros at π.
    #[serde(rename = "bior2.8")]
    Bior28,
    /// Biorthogonal spline, 3 vanishing moments, 5 zeros at π.
    #[serde(rename = "bior3.5")]
    Bior35,
    /// Biorthogonal spline, 3 vanishing moments, 9 zeros at π.
    #[serde(rename = "bior3.9")]
    Bior39,
    /// Biorthogonal, 9 and 7 taps, 4 vanishing moments.
    #[serde(rename = "bior4.4")]
    Bior44,
}

impl WaveletName {
    /// The wavelet; none for Morlet's, which is complex and has plans of its own.
    #[must_use]
    pub fn shape(self) -> Option<Wavelet> {
        Some(match self {
            Self::Morlet => return None,
            Self::MexicanHat => Wavelet::MexicanHat,
            Self::Haar => Wavelet::Haar,
            Self::Db2 => Wavelet::Daubechies(2),
            Self::Db4 => Wavelet::Daubechies(4),
            Self::Db6 => Wavelet::Daubechies(6),
            Self::Db8 => Wavelet::Daubechies(8),
            Self::Db10 => Wavelet::Daubechies(10),
            Self::Bior13 => Wavelet::Biorthogonal(1, 3),
            Self::Bior15 => Wavelet::Biorthogonal(1, 5),
            Self::Bior24 => Wavelet::Biorthogonal(2, 4),
            Self::Bior28 => Wavelet::Biorthogonal(2, 8),
            Self::Bior35 => Wavelet::Biorthogonal(3, 5),
            Self::Bior39 => Wavelet::Biorthogonal(3, 9),
            Self::Bior44 => Wavelet::NineSeven,
        })
    }

    /// As it is written.
    #[must_use]
    pub fn name(self) -> String {
        let value = serde_json::to_value(self).unwrap_or_default();
        value.as_str().unwrap_or_default().to_owned()
    }
}

/// Which bilinear distribution.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum JointKind {
    /// Wigner–Ville: sharpest, with a cross term between any two lines.
    WignerVille,
    /// Pseudo Wigner–Ville: lags under a window.
    PseudoWignerVille,
    /// Smoothed pseudo Wigner–Ville: averaged over time too, so that cross terms fall.
    #[default]
    SmoothedPseudoWignerVille,
    /// Choi–Williams: averaged over time the more the longer the lag.
    ChoiWilliams,
}

/// A bilinear distribution.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct JointWire {
    /// Channel.
    pub channel: String,
    /// Kind.
    pub kind: JointKind,
    /// Unit of `value`.
    pub unit: String,
    /// Half width of the window over lags, s.
    pub lag_s: Option<f64>,
    /// Half width of the window over time, s; null where there is none.
    pub smoothing_s: Option<f64>,
    /// σ of Choi and Williams; null for the others.
    pub sigma: Option<f64>,
    /// First sample used.
    pub start_sample: u64,
    /// Number of samples used.
    pub n_samples: usize,
    /// Whether they can be trusted.
    pub validity: Validity,
    /// Distance of two frequencies before thinning, Hz.
    pub bin_width_hz: Option<f64>,
    /// Whether each row is the largest in magnitude of several bins.
    pub decimated: bool,
    /// Rows: frequencies, Hz.
    pub frequency_hz: Vec<Option<f64>>,
    /// Columns: instants of stream time, s.
    pub time_s: Vec<Option<f64>>,
    /// Density of the analytic signal's power over time and frequency, of either sign, one array a frequency: a line of
    /// amplitude A integrates to A² over frequency.
    pub value: Vec<Vec<Option<f64>>>,
}
