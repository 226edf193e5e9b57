//! Gauss–Legendre integration of smooth functions.

use std::f64::consts::PI;

/// Points of the rule: exact for polynomials up to degree 39.
const N: u32 = 20;

/// Places and weights on [−1, 1].
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rule(Vec<(f64, f64)>);

impl Rule {
    /// Roots of the Legendre polynomial by Newton's method.
    pub(super) fn new() -> Self {
        let n = f64::from(N);
        let root = |k: u32| {
            let mut x = (PI * (f64::from(k) + 0.75) / (n + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..20 {
                let (mut before, mut here) = (1.0, x);
                for j in 2..=N {
                    let j = f64::from(j);
                    (before, here) = (here, ((2.0 * j - 1.0) * x * here - (j - 1.0) * before) / j);
                }
                slope = n * (before - x * here) / (1.0 - x * x);
                x -= here / slope;
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        };
        Self((0..N).map(root).collect())
    }

    /// ∫ f over [`from`, `to`]; 0 if `to` is not above `from`.
    pub(super) fn integrate<const M: usize>(
        &self,
        from: f64,
        to: f64,
        f: impl Fn(f64) -> [f64; M],
    ) -> [f64; M] {
        let mut sum = [0.0; M];
        if to <= from {
            return sum;
        }
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        for (x, weight) in &self.0 {
            let value = f(middle + half * x);
            for (sum, value) in sum.iter_mut().zip(value) {
                *sum += half * weight * value;
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_are_integrated_exactly() {
        let rule = Rule::new();
        for power in [0, 1, 2, 17, 38] {
            let [found] = rule.integrate(0.0, 2.0, |x| [x.powi(power)]);
            let exact = 2.0_f64.powi(power + 1) / f64::from(power + 1);
            assert!((found / exact - 1.0).abs() < 1e-13, "{power}: {found} {exact}");
        }
        let [sine] = rule.integrate(0.0, PI, |x| [x.sin()]);
        assert!((sine - 2.0).abs() < 1e-14);
    }
}
