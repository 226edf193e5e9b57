//! What makes computers comparable, shared by the benches: one forward transform of 8192 points, f32.

use cpu_time::ProcessTime;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex32;

/// CPU time of one yardstick transform, s.
pub(crate) fn fft_s() -> f64 {
    let fft = FftPlanner::<f32>::new().plan_fft_forward(8192);
    let mut data = vec![Complex32::new(1.0, 0.0); 8192];
    let mut scratch = vec![Complex32::default(); fft.get_inplace_scratch_len()];
    let repeats = 500;
    let start = ProcessTime::now();
    for _ in 0..repeats {
        fft.process_with_scratch(&mut data, &mut scratch);
        std::hint::black_box(&mut data).fill(Complex32::new(1.0, 0.0));
    }
    start.elapsed().as_secs_f64() / f64::from(repeats)
}

/// Sorts, and gives the middle.
pub(crate) fn median(times_s: &mut [f64]) -> f64 {
    times_s.sort_by(f64::total_cmp);
    times_s[times_s.len() / 2]
}
