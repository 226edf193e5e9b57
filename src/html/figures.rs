//! Pictures of the signals themselves: spectrum, waveform, orbit, wavelet map.

use super::envelope::Figure;
use super::recording::Track;
use super::recording::find;
use crate::dsp::cwt::DEFAULT_OMEGA0;
use crate::dsp::cwt::Part;
use crate::dsp::cwt::ScalogramPlan;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::spectrum::AmplitudePlan;
use crate::machine::Machine;
use crate::machine::gear::GearMesh;
use crate::plot::Words;
use crate::plot::chart::Chart;
use crate::plot::chart::Cursor;
use crate::plot::chart::Scale;
use crate::plot::decimate;
use crate::plot::map::Map;
use rustfft::num_complex::Complex;

const POINTS_MAX: usize = 1600;
const SIZE: (f64, f64) = (860.0, 280.0);

/// Revolutions of a waveform, of an orbit, of a wavelet map; and their seconds when no speed is known.
const TURNS: f64 = 6.0;
const TURNS_S: f64 = 0.25;

/// Shaft harmonics marked in an amplitude spectrum.
const SHAFT_HARMONICS: u32 = 3;

/// Rows and columns of a wavelet map.
const MAP: (usize, usize) = (56, 180);

/// Parts of the mesh frequency between which a wavelet map is drawn; the lowest one is not below half the shaft's.
const MAP_OF_MESH: f64 = 2.5;

/// Time shown, s.
fn span_s(shaft_hz: Option<f64>) -> f64 {
    shaft_hz.filter(|hz| *hz > 0.0).map_or(TURNS_S, |hz| TURNS / hz)
}

/// Amplitudes over the whole record, logarithmic.
pub(super) fn spectrum(track: &Track, shaft_hz: Option<f64>) -> Option<Figure> {
    if track.samples.len() < 16 {
        return None;
    }
    let mut cache = FftCache::new();
    let mut plan = AmplitudePlan::new(track.samples.len(), &mut cache);
    let mut values = vec![0.0_f32; plan.n_bins()];
    plan.process(&track.samples, &mut values);
    let width_hz = plan.bin_width_hz(track.fs_hz());
    let value = |i: usize| f64::from(values[i + 1]);
    let kept = decimate::peaks(values.len() - 1, POINTS_MAX, value);
    let points: Vec<(f64, f64)> =
        kept.iter().map(|i| ((*i + 1) as f64 * width_hz, value(*i))).collect();
    let largest = points.iter().map(|(_, a)| *a).fold(0.0, f64::max);
    let title = format!("Amplitude spectrum of {}", track.info.name);
    let y = format!("amplitude ({}, 0-p)", track.info.unit.symbol());
    let shaft = |hz: f64| {
        (1..=SHAFT_HARMONICS).map(move |n| Cursor {
            x: f64::from(n) * hz,
            label: format!("{n}×"),
            class: "shaft",
        })
    };
    let svg = Chart {
        words: Words { title: &title, x: "frequency (Hz)", y: &y },
        size: SIZE,
        x: (0.0, 0.5 * track.fs_hz()),
        y: Scale::Logarithmic(largest),
        lines: vec![("line", points)],
        cursors: shaft_hz.into_iter().flat_map(shaft).collect(),
    }
    .svg()?;
    let caption = format!(
        "{} samples at {} Hz, Hann window, resolution {:.3} Hz; the largest of each stretch is drawn.",
        track.samples.len(),
        track.fs_hz(),
        width_hz
    );
    Some(Figure { svg, caption })
}

/// The first revolutions.
pub(super) fn waveform(track: &Track, shaft_hz: Option<f64>) -> Option<Figure> {
    let samples = track.first(span_s(shaft_hz));
    if samples.is_empty() {
        return None;
    }
    let mean = samples.iter().map(|v| f64::from(*v)).sum::<f64>() / samples.len() as f64;
    let value = |i: usize| f64::from(samples[i]) - mean;
    let kept = decimate::min_max(samples.len(), POINTS_MAX, value);
    let at_s = |i: usize| track.start_s + i as f64 / track.fs_hz();
    let points: Vec<(f64, f64)> = kept.iter().map(|i| (at_s(*i), value(*i))).collect();
    let size = points.iter().map(|(_, v)| v.abs()).fold(0.0, f64::max);
    let title = format!("Waveform of {}", track.info.name);
    let y = track.info.unit.symbol();
    let svg = Chart {
        words: Words { title: &title, x: "time (s)", y },
        size: (SIZE.0, 230.0),
        x: (track.start_s, at_s(samples.len())),
        y: Scale::Linear(-1.05 * size, 1.05 * size),
        lines: vec![("line", points)],
        cursors: Vec::new(),
    }
    .svg()?;
    let turns = if shaft_hz.is_some() { "six revolutions" } else { "a quarter of a second" };
    let constant = mean + track.info.offset;
    let caption = format!("At most the first {turns}; their mean, {constant:.3} {y}, is left out.");
    Some(Figure { svg, caption })
}

/// Orbits of all x/y pairs, x to the right and y upwards as the sensors point.
pub(super) fn orbits(machine: &Machine, shaft_hz: Option<f64>, tracks: &[Track]) -> Vec<Figure> {
    let orbit = |x: &str, y: &str| {
        let (x, y) = (find(tracks, x)?, find(tracks, y)?);
        let (xs, ys) = (x.first(span_s(shaft_hz)), y.first(span_s(shaft_hz)));
        let together = x.start == y.start && x.info.sample_rate == y.info.sample_rate;
        if !together || xs.is_empty() {
            return None;
        }
        let mean = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64;
        let (mean_x, mean_y) = (mean(xs), mean(ys));
        let step = xs.len().div_ceil(2 * POINTS_MAX).max(1);
        let pairs = xs.iter().zip(ys).step_by(step);
        let points: Vec<(f64, f64)> =
            pairs.map(|(a, b)| (f64::from(*a) - mean_x, f64::from(*b) - mean_y)).collect();
        let size = points.iter().map(|(a, b)| a.abs().max(b.abs())).fold(0.0, f64::max) * 1.05;
        let title = format!("Orbit of {} and {}", x.info.name, y.info.name);
        let unit = x.info.unit.symbol();
        let (across, up) =
            (format!("{} ({unit})", x.info.name), format!("{} ({unit})", y.info.name));
        let svg = Chart {
            words: Words { title: &title, x: &across, y: &up },
            size: (380.0, 368.0),
            x: (-size, size),
            y: Scale::Linear(-size, size),
            lines: vec![("line", points)],
            cursors: Vec::new(),
        }
        .svg()?;
        Some(Figure { svg, caption: "The same time as the waveforms, means left out.".to_owned() })
    };
    let channel = |index: usize| machine.sensors[index].channel.as_str();
    let pairs = machine.sensor_pairs().into_iter();
    pairs.filter_map(|pair| orbit(channel(pair.x), channel(pair.y))).collect()
}

/// The wavelet map of the first revolutions around the mesh frequency.
pub(super) fn wavelet_map(
    mesh: &GearMesh,
    (driving_hz, driven_hz): (f64, f64),
    track: &Track,
) -> Option<Figure> {
    let slower_hz = driving_hz.min(driven_hz);
    // The ends of the stretch that wavelets reach over are cut off below.
    let mesh_hz = f64::from(mesh.driving.teeth) * driving_hz;
    let (low_hz, high_hz) = (0.5 * slower_hz, (MAP_OF_MESH * mesh_hz).min(0.45 * track.fs_hz()));
    let span_s = (TURNS + 4.0) / slower_hz;
    let samples = track.first(span_s);
    if !(low_hz > 0.0 && low_hz < high_hz) || samples.len() < 64 {
        return None;
    }
    let (n_rows, n_columns) = MAP;
    let step_hz = (high_hz - low_hz) / n_rows as f64;
    let f_hz: Vec<f64> = (0..n_rows).map(|i| low_hz + (i as f64 + 0.5) * step_hz).collect();
    let mut cache = FftCache::new();
    let mut plan = ScalogramPlan::new(
        samples.len(),
        track.fs_hz(),
        &f_hz,
        DEFAULT_OMEGA0,
        n_columns,
        &mut cache,
    )?;
    let mut forward = ForwardPlan::new(samples.len(), &mut cache);
    let mut x_hat = vec![Complex::new(0.0, 0.0); forward.n_bins()];
    forward.process(samples, &mut x_hat);
    let mut values = vec![0.0_f32; plan.out_len()];
    plan.process(&x_hat, Part::Modulus, &mut values);
    let row = |(i, values): (usize, &[f32])| {
        let valid = plan.valid_columns(i).unwrap_or(0..0);
        let column = |(k, v): (usize, &f32)| if valid.contains(&k) { f64::from(*v) } else { 0.0 };
        (low_hz + i as f64 * step_hz, values.iter().enumerate().map(column).collect())
    };
    let title = format!("Wavelet map of {}, mesh {}", track.info.name, mesh.id);
    let svg = Map {
        words: Words { title: &title, x: "time (s)", y: "frequency (Hz)" },
        size: (SIZE.0, 360.0),
        x: (track.start_s, track.start_s + samples.len() as f64 / track.fs_hz()),
        y: (low_hz, high_hz),
        rows: values.chunks(n_columns).enumerate().map(row).collect(),
        marks: vec![
            (driving_hz, "1× driving".to_owned()),
            (mesh_hz, "GMF".to_owned()),
            (2.0 * mesh_hz, "2·GMF".to_owned()),
        ],
    }
    .svg()?;
    let caption = format!(
        "Amplitude of the Morlet wavelet transform, darker is larger. A damaged tooth shows as a spot that comes back \
         once a revolution of its shaft ({:.3} s driving, {:.3} s driven). Where a wavelet reaches over the ends nothing is drawn.",
        1.0 / driving_hz,
        1.0 / driven_hz
    );
    Some(Figure { svg, caption })
}
