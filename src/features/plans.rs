//! Plans of transforms, kept from window to window.
//!
//! A stream's windows have one length and its sensors the same bands, so plans recur; a plan gives the same bits
//! new or used. What is kept is bounded, the plans longest unused go first. Must not know what the transforms are read for.

use crate::dsp::envelope::EnvelopeSpectrumPlan;
use crate::dsp::envelope::SquaredEnvelopePlan;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::integrate::VelocityPlan;
use crate::dsp::spectrum::AmplitudePlan;
use std::ops::Range;

/// Points of the plans of one kind that are kept: 20 to 40 bytes each, so 40 to 80 MB of a kind at most. Ten seconds of a channel
/// have 7 bands, 3 times their samples: enough for all up to 70 kHz.
const MOST_POINTS: usize = 1 << 21;

/// Lengths of transforms of which tables are kept.
const MOST_LENGTHS: usize = 256;

/// Plans by what they are for.
#[derive(Debug)]
pub struct Plans {
    cache: FftCache<f32>,
    wide: FftCache<f64>,
    forward: Kept<usize, ForwardPlan<f32>>,
    velocity: Kept<usize, VelocityPlan<f32>>,
    padded: Kept<usize, AmplitudePlan<f32>>,
    squared: Kept<(usize, Range<usize>), SquaredEnvelopePlan<f32>>,
    envelope: Kept<usize, EnvelopeSpectrumPlan<f32>>,
}

impl Plans {
    /// None yet.
    #[must_use]
    pub fn new() -> Self {
        Self {
            cache: FftCache::new(),
            wide: FftCache::new(),
            forward: Kept::new(MOST_POINTS),
            velocity: Kept::new(MOST_POINTS),
            padded: Kept::new(MOST_POINTS),
            squared: Kept::new(MOST_POINTS),
            envelope: Kept::new(MOST_POINTS),
        }
    }

    /// Tables for plans that are used once.
    pub fn tables(&mut self) -> &mut FftCache<f32> {
        bound(&mut self.cache)
    }

    /// The same in f64.
    pub fn wide_tables(&mut self) -> &mut FftCache<f64> {
        bound(&mut self.wide)
    }

    /// The spectrum of `n` samples.
    pub fn forward(&mut self, n: usize) -> &mut ForwardPlan<f32> {
        let cache = bound(&mut self.cache);
        self.forward.get(n, n, || ForwardPlan::new(n, cache))
    }

    /// The velocity of `n` samples.
    pub fn velocity(&mut self, n: usize) -> &mut VelocityPlan<f32> {
        let cache = bound(&mut self.cache);
        self.velocity.get(n, n, || VelocityPlan::new(n, cache))
    }

    /// Amplitudes of `n` samples, twice padded.
    pub fn padded(&mut self, n: usize) -> &mut AmplitudePlan<f32> {
        let cache = bound(&mut self.cache);
        self.padded.get(n, 2 * n, || AmplitudePlan::new_padded(n, 2 * n, cache))
    }

    /// Squared envelope of the bins `bins` of the spectrum of `n` samples.
    pub fn squared_envelope(
        &mut self,
        n: usize,
        bins: Range<usize>,
    ) -> &mut SquaredEnvelopePlan<f32> {
        let cache = bound(&mut self.cache);
        let points = 2 * bins.len();
        self.squared.get((n, bins.clone()), points, || SquaredEnvelopePlan::new(n, bins, cache))
    }

    /// Modulation depths of `n` samples of e².
    pub fn envelope_spectrum(&mut self, n: usize) -> &mut EnvelopeSpectrumPlan<f32> {
        let cache = bound(&mut self.cache);
        self.envelope.get(n, 2 * n, || EnvelopeSpectrumPlan::new(n, cache))
    }
}

impl Default for Plans {
    fn default() -> Self {
        Self::new()
    }
}

/// Lengths follow speeds, so that they are many in a year: from time to time all tables are new.
fn bound<T: crate::dsp::real::Real>(cache: &mut FftCache<T>) -> &mut FftCache<T> {
    if cache.n_lengths() > MOST_LENGTHS {
        *cache = FftCache::new();
    }
    cache
}

/// Plans of one kind, those used last first.
#[derive(Debug)]
struct Kept<K, P> {
    plans: Vec<(K, usize, Box<P>)>,
    most_points: usize,
}

impl<K: PartialEq, P> Kept<K, P> {
    fn new(most_points: usize) -> Self {
        Self { plans: Vec::new(), most_points }
    }

    /// The plan for `key`, made if there is none; `points` is what it counts.
    fn get(&mut self, key: K, points: usize, make: impl FnOnce() -> P) -> &mut P {
        match self.plans.iter().position(|(known, ..)| *known == key) {
            Some(at) => self.plans[..=at].rotate_right(1),
            None => {
                let mut total = points;
                self.plans.retain(|(_, points, _)| {
                    total += points;
                    total <= self.most_points
                });
                self.plans.insert(0, (key, points, Box::new(make())));
            }
        }
        &mut self.plans[0].2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_unused_go_first_and_the_bound_holds() {
        let mut kept = Kept::new(10);
        let mut n_made = 0;
        let mut get = |key: u32, points: usize, kept: &mut Kept<u32, u32>| {
            let mut is_new = false;
            let plan = *kept.get(key, points, || {
                is_new = true;
                n_made += 1;
                key
            });
            assert_eq!(plan, key);
            is_new
        };
        assert!(get(1, 4, &mut kept) && get(2, 4, &mut kept) && !get(1, 4, &mut kept));
        // 1 was used after 2, so 2 goes.
        assert!(get(3, 5, &mut kept) && !get(1, 4, &mut kept) && get(2, 4, &mut kept));
        // One alone above the bound is used and goes with the next.
        assert!(get(4, 40, &mut kept) && kept.plans.len() == 1);
        assert!(get(5, 1, &mut kept) && kept.plans.len() == 1);
        assert_eq!(n_made, 6);
    }

    #[test]
    fn tables_of_ever_new_lengths_stay_bounded() {
        let mut plans = Plans::new();
        for n in 1..2 * MOST_LENGTHS {
            let _plan = ForwardPlan::new(16 * n, plans.tables());
            assert!(plans.cache.n_lengths() <= MOST_LENGTHS + 2);
        }
    }
}
