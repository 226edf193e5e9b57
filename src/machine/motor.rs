//! Electric motors: the source of lines that are no faults.
//!
//! Equations K12–K13 of `docs/theory.md`.

use super::ShaftIndex;
use crate::units::Hz;

/// Supply frequencies of the world, Hz.
pub const MAINS_HZ: [f64; 2] = [50.0, 60.0];

/// How far the mains of a large grid leave their nominal frequency, relative.
pub const MAINS_WANDER: f64 = 2e-3;

/// An electric motor on a shaft.
#[derive(Debug, Clone, PartialEq)]
pub struct Motor {
    /// Shaft it drives.
    pub shaft: ShaftIndex,
    /// Number of poles, even, ≥ 2.
    pub poles: u32,
    /// Mains or nominal inverter output frequency; `None`: no mains lines are excluded, unless
    /// the motor is synchronous.
    pub line_frequency: Option<Hz>,
    /// A synchronous motor: line frequency = poles/2 · shaft speed.
    pub synchronous: bool,
}

impl Motor {
    /// Supply frequency at a shaft speed: poles/2·f for a synchronous motor (K13), else the
    /// stated line frequency; `None` when that is not stated.
    #[must_use]
    pub fn supply_frequency(&self, shaft_speed: Hz) -> Option<Hz> {
        if self.synchronous {
            return Some(Hz(0.5 * f64::from(self.poles) * shaft_speed.0));
        }
        self.line_frequency
    }

    /// Slip speed 2·f_line/poles − f of an induction motor, negative above synchronous speed
    /// (K12); `None` for a synchronous motor or an unknown line frequency.
    #[must_use]
    pub fn slip_speed(&self, shaft_speed: Hz) -> Option<Hz> {
        let line = self.line_frequency.filter(|_| !self.synchronous)?;
        Some(Hz(2.0 * line.0 / f64::from(self.poles) - shaft_speed.0))
    }

    /// Pole-pass frequency |slip speed|·poles (K12); `None` as for [`Self::slip_speed`].
    #[must_use]
    pub fn pole_pass_frequency(&self, shaft_speed: Hz) -> Option<Hz> {
        self.slip_speed(shaft_speed).map(|slip| Hz((slip.0 * f64::from(self.poles)).abs()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pole_pass_is_slip_times_poles() {
        let line_frequency = Some(Hz(60.0));
        let motor = Motor { shaft: ShaftIndex(0), poles: 4, line_frequency, synchronous: false };
        // 60 Hz, 4 poles: 30 Hz synchronous; at 29.5 Hz the slip is 0.5 Hz, pole pass 2 Hz.
        assert_eq!(motor.slip_speed(Hz(29.5)), Some(Hz(0.5)));
        assert_eq!(motor.pole_pass_frequency(Hz(29.5)), Some(Hz(2.0)));
        assert_eq!(motor.pole_pass_frequency(Hz(30.5)), Some(Hz(2.0)));
        assert_eq!(motor.supply_frequency(Hz(29.5)), Some(Hz(60.0)));
    }

    #[test]
    fn synchronous_motor_has_no_slip_and_drags_its_supply_along() {
        let motor =
            Motor { shaft: ShaftIndex(0), poles: 8, line_frequency: None, synchronous: true };
        assert_eq!(motor.supply_frequency(Hz(25.0)), Some(Hz(100.0)));
        assert_eq!(motor.slip_speed(Hz(25.0)), None);
        assert_eq!(motor.pole_pass_frequency(Hz(25.0)), None);
    }
}
