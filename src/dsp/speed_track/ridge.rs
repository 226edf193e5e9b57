//! The most probable way through the scores of frames, and its probability (D74).
//!
//! Speeds on a grid; from frame to frame the speed moves by at most `reach` steps, all moves equally
//! probable. The best way is found by dynamic programming, its probability by summing over all ways.

use crate::dsp::real::floor_index;

/// Scores and ways.
#[derive(Debug)]
pub(super) struct Ridge {
    n_states: usize,
    n_frames: usize,
    reach: usize,
    low_hz: f64,
    step_hz: f64,
    /// Per frame and state: score; logarithm of the sum over all ways up to there.
    scores: Vec<f64>,
    forward: Vec<f64>,
    /// State before, on the best way.
    before: Vec<u32>,
    best: Vec<f64>,
    next: Vec<f64>,
    path: Vec<usize>,
    confidence: Vec<f64>,
}

impl Ridge {
    pub(super) fn new(
        n_states: usize,
        n_frames: usize,
        reach: usize,
        low_hz: f64,
        step_hz: f64,
    ) -> Self {
        let cells = n_states * n_frames;
        Self {
            n_states,
            n_frames,
            reach,
            low_hz,
            step_hz,
            scores: vec![0.0; cells],
            forward: vec![0.0; cells],
            before: vec![0; cells],
            best: vec![0.0; n_states],
            next: vec![0.0; n_states],
            path: vec![0; n_frames],
            confidence: vec![0.0; n_frames],
        }
    }

    pub(super) fn n_states(&self) -> usize {
        self.n_states
    }

    pub(super) fn n_frames(&self) -> usize {
        self.n_frames
    }

    pub(super) fn speed_hz(&self, state: usize) -> f64 {
        self.low_hz + state as f64 * self.step_hz
    }

    pub(super) fn path_hz(&self, frame: usize) -> f64 {
        self.speed_hz(self.path[frame])
    }

    pub(super) fn set_score(&mut self, frame: usize, state: usize, score: f64) {
        self.scores[frame * self.n_states + state] = score;
    }

    /// Finds the best way and the probability of each of its frames within `near_hz`; returns the mean.
    pub(super) fn solve(&mut self, near_hz: f64) -> f64 {
        self.find_path();
        let evidence = self.sum_forward();
        // There is a comb, against none: equally probable beforehand.
        let exists = 1.0 / (1.0 + (-evidence).exp());
        self.sum_backward(near_hz, exists);
        self.confidence.iter().sum::<f64>() / self.n_frames as f64
    }

    fn find_path(&mut self) {
        let n = self.n_states;
        self.best.copy_from_slice(&self.scores[..n]);
        for frame in 1..self.n_frames {
            for state in 0..n {
                let from = state.saturating_sub(self.reach)..(state + self.reach + 1).min(n);
                // From the middle outwards would favour none either; equal ways take the lowest.
                let better = |a: usize, b: usize| if self.best[b] > self.best[a] { b } else { a };
                let before = from.clone().fold(from.start, better);
                let cell = frame * n + state;
                self.before[cell] = u32::try_from(before).unwrap_or(0);
                self.next[state] = self.best[before] + self.scores[cell];
            }
            std::mem::swap(&mut self.best, &mut self.next);
        }
        let better = |a: usize, b: usize| if self.best[b] > self.best[a] { b } else { a };
        let mut state = (0..n).fold(0, better);
        for frame in (0..self.n_frames).rev() {
            self.path[frame] = state;
            state = self.before[frame * n + state] as usize;
        }
    }

    /// Logarithm of the mean over all ways of the product of their likelihoods.
    fn sum_forward(&mut self) -> f64 {
        let n = self.n_states;
        let start = -(n as f64).ln();
        for state in 0..n {
            self.forward[state] = self.scores[state] + start;
        }
        for frame in 1..self.n_frames {
            let (done, rest) = self.forward.split_at_mut(frame * n);
            self.next.copy_from_slice(&done[(frame - 1) * n..]);
            spread(&self.next, self.reach, true, &mut self.best);
            let scores = &self.scores[frame * n..];
            for ((forward, best), score) in rest.iter_mut().zip(&self.best).zip(scores) {
                *forward = best + score;
            }
        }
        log_sum(&self.forward[(self.n_frames - 1) * n..])
    }

    fn sum_backward(&mut self, near_hz: f64, exists: f64) {
        let n = self.n_states;
        let near = floor_index(near_hz / self.step_hz);
        // ln of the sum over all ways from here on, the frame's own score left out.
        self.best.fill(0.0);
        for frame in (0..self.n_frames).rev() {
            let row = frame * n;
            for state in 0..n {
                self.next[state] = self.forward[row + state] + self.best[state];
            }
            let at = self.path[frame];
            let around = at.saturating_sub(near)..(at + near + 1).min(n);
            let share = log_sum(&self.next[around]) - log_sum(&self.next);
            self.confidence[frame] = share.exp().min(1.0) * exists;
            if frame > 0 {
                for state in 0..n {
                    self.next[state] = self.scores[row + state] + self.best[state];
                }
                spread(&self.next, self.reach, false, &mut self.best);
            }
        }
    }
}

/// Logarithm of the mean (or sum over the moves from each place) of exp(x) within `reach` of each place.
///
/// Moves from a place are equally probable, so a place near an end has fewer and more probable ones:
/// `from` says whether the places summed over are those moved from (forward) or to (backward).
fn spread(x: &[f64], reach: usize, from: bool, out: &mut [f64]) {
    let n = x.len();
    let n_moves = |place: usize| ((place + reach + 1).min(n) - place.saturating_sub(reach)) as f64;
    for (place, out) in out.iter_mut().enumerate() {
        let around = place.saturating_sub(reach)..(place + reach + 1).min(n);
        let top = x[around.clone()].iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = around
            .map(|other| (x[other] - top).exp() / n_moves(if from { other } else { place }))
            .sum();
        *out = top + sum.ln();
    }
}

fn log_sum(x: &[f64]) -> f64 {
    let top = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    top + x.iter().map(|value| (value - top).exp()).sum::<f64>().ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn way_and_probability_are_those_of_all_ways_counted() {
        // 4 states, 4 frames, moves of at most 1: every way by hand.
        let scores = [
            [0.3, 1.0, -0.5, 0.2],
            [0.1, -2.0, 1.5, 0.4],
            [0.9, 0.2, -0.1, 1.1],
            [-0.3, 0.8, 0.6, 0.0],
        ];
        let mut ridge = Ridge::new(4, 4, 1, 10.0, 0.5);
        for (frame, row) in scores.iter().enumerate() {
            for (state, score) in row.iter().enumerate() {
                ridge.set_score(frame, state, *score);
            }
        }
        let mean = ridge.solve(0.0);
        let (mut total, mut best) = (0.0, (f64::NEG_INFINITY, [0; 4]));
        let mut through = [[0.0; 4]; 4];
        for code in 0..256_usize {
            let way = [code & 3, code >> 2 & 3, code >> 4 & 3, code >> 6 & 3];
            if way.windows(2).any(|pair| pair[0].abs_diff(pair[1]) > 1) {
                continue;
            }
            let moves: f64 =
                way[..3].iter().map(|s| if *s == 0 || *s == 3 { 0.5 } else { 1.0 / 3.0 }).product();
            let score: f64 = way.iter().enumerate().map(|(frame, s)| scores[frame][*s]).sum();
            let probability = 0.25 * moves * score.exp();
            total += probability;
            for (frame, state) in way.iter().enumerate() {
                through[frame][*state] += probability;
            }
            best = if score > best.0 { (score, way) } else { best };
        }
        let exists = total / (1.0 + total);
        let mut expected = 0.0;
        for (frame, state) in best.1.into_iter().enumerate() {
            assert!((ridge.path_hz(frame) - 10.0 - 0.5 * state as f64).abs() < 1e-12);
            let share = through[frame][state] / total * exists;
            assert!((ridge.confidence[frame] - share).abs() < 1e-12);
            expected += 0.25 * share;
        }
        assert!((mean - expected).abs() < 1e-12);
    }
}
