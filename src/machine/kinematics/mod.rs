//! Every line a machine's spectrum may show by its construction, labelled.
//!
//! (Machine, speed of the first shaft) to [`FrequencyTable`]: shaft harmonics, bearing rates, mesh
//! lines and the lines of the supply. The table says where lines may stand, never whether one does:
//! it must not know signals or faults. Equations K2–K14 of `docs/theory.md`.

pub mod line;
pub mod coincidence;

use line::{FrequencyLine, LineKind, Member, Owner, Unlisted};

use super::{BearingIndex, GearIndex, Machine, MotorIndex, ShaftIndex};
use crate::machine::uncertainty::RelativeBand;
use crate::units::Hz;

/// Harmonics listed of shaft, bearing and mesh lines.
pub const HARMONICS: u8 = 3;

/// The labelled lines of a machine at one speed.
#[derive(Debug, Clone, PartialEq)]
pub struct FrequencyTable {
    /// Speed of the first shaft it was made for.
    pub first_shaft_speed: Hz,
    /// Lines, in the order shafts, bearings, gears, motors; all frequencies > 0 and finite.
    pub lines: Vec<FrequencyLine>,
    /// Parts that have no lines here, and why.
    pub unlisted: Vec<(Owner, Unlisted)>,
}

/// Lists every line of the machine when its first shaft turns at `first_shaft_speed`.
///
/// A part whose speed or geometry is unknown goes to [`FrequencyTable::unlisted`] with the reason.
/// A speed that is not positive and finite counts as standstill: only mains lines are listed.
#[must_use]
pub fn frequency_table(machine: &Machine, first_shaft_speed: Hz) -> FrequencyTable {
    let mut table = FrequencyTable { first_shaft_speed, lines: Vec::new(), unlisted: Vec::new() };
    let builder = Builder { machine, first_shaft_speed };
    for index in 0..machine.shafts.len() {
        builder.shaft(ShaftIndex(index), &mut table);
    }
    for index in 0..machine.bearings.len() {
        builder.bearing(BearingIndex(index), &mut table);
    }
    for index in 0..machine.gears.len() {
        builder.gear(GearIndex(index), &mut table);
    }
    for index in 0..machine.motors.len() {
        builder.motor(MotorIndex(index), &mut table);
    }
    table
}

/// What every part of the table is made from.
struct Builder<'m> {
    machine: &'m Machine,
    first_shaft_speed: Hz,
}

impl Builder<'_> {
    /// Speed of a turning shaft, or why there is none.
    fn speed(&self, shaft: ShaftIndex) -> Result<Hz, Unlisted> {
        let speed = self.machine.shaft_speed(shaft, self.first_shaft_speed);
        let speed = speed.ok_or(Unlisted::SpeedNotConnected)?;
        if speed.0.is_finite() && speed.0 > 0.0 { Ok(speed) } else { Err(Unlisted::Standstill) }
    }

    fn shaft(&self, index: ShaftIndex, table: &mut FrequencyTable) {
        let owner = Owner::Shaft(index);
        match self.speed(index) {
            Err(reason) => table.unlisted.push((owner, reason)),
            Ok(speed) => {
                let mut lines = Lines::new(self.machine, table, owner, index, Some(speed));
                for harmonic in 1..=HARMONICS {
                    let frequency = Hz(f64::from(harmonic) * speed.0);
                    lines.push(LineKind::Shaft { harmonic }, frequency);
                }
            }
        }
    }

    /// K2–K6 at the speed of the bearing's shaft.
    fn bearing(&self, index: BearingIndex, table: &mut FrequencyTable) {
        let owner = Owner::Bearing(index);
        let bearing = self.machine.bearing(index);
        let speed = match self.speed(bearing.shaft) {
            Ok(speed) => speed,
            Err(reason) => return table.unlisted.push((owner, reason)),
        };
        let Some(rates) = bearing.fault_rates(speed) else {
            return table.unlisted.push((owner, Unlisted::NoGeometry));
        };
        let bands = bearing.bands;
        let mut lines = Lines::new(self.machine, table, owner, bearing.shaft, Some(speed));
        for harmonic in 1..=HARMONICS {
            let times = |rate: Hz| Hz(f64::from(harmonic) * rate.0);
            lines.within(bands.ftf).push(LineKind::Ftf { harmonic }, times(rates.ftf));
            lines.within(bands.bpfo).push(LineKind::Bpfo { harmonic }, times(rates.bpfo));
            lines.within(bands.bpfi).push(LineKind::Bpfi { harmonic }, times(rates.bpfi));
            let two_bsf = times(rates.two_bsf());
            lines.within(bands.two_bsf).push(LineKind::TwoBsf { harmonic }, two_bsf);
        }
        lines.within(bands.two_bsf).push(LineKind::Bsf, rates.bsf);
    }

    /// K9–K11: mesh harmonics, first side bands of both members, hunting tooth.
    fn gear(&self, index: GearIndex, table: &mut FrequencyTable) {
        let owner = Owner::Gear(index);
        let gear = self.machine.gear(index);
        let (driving, driven) =
            match (self.speed(gear.driving.shaft), self.speed(gear.driven.shaft)) {
                (Ok(driving), Ok(driven)) => (driving, driven),
                (Err(reason), _) | (_, Err(reason)) => return table.unlisted.push((owner, reason)),
            };
        let mesh = gear.mesh_frequency(driving);
        let mut lines = Lines::new(self.machine, table, owner, gear.driving.shaft, Some(driving));
        for harmonic in 1..=HARMONICS {
            lines.push(LineKind::GearMesh { harmonic }, Hz(f64::from(harmonic) * mesh.0));
        }
        lines.push(LineKind::HuntingTooth, gear.hunting_tooth_frequency(driving));
        let members = [
            (Member::Driving, gear.driving.shaft, driving),
            (Member::Driven, gear.driven.shaft, driven),
        ];
        for (member, shaft, speed) in members {
            let mut lines = Lines::new(self.machine, table, owner, shaft, Some(speed));
            lines.push(LineKind::LowerSideBand { member }, Hz(mesh.0 - speed.0));
            lines.push(LineKind::UpperSideBand { member }, Hz(mesh.0 + speed.0));
        }
    }

    /// K12–K13: the supply's lines, also at standstill when the line frequency is stated.
    fn motor(&self, index: MotorIndex, table: &mut FrequencyTable) {
        let owner = Owner::Motor(index);
        let motor = &self.machine.motors[index.0];
        let speed = self.speed(motor.shaft);
        if !motor.synchronous && motor.line_frequency.is_none() {
            return table.unlisted.push((owner, Unlisted::NoLineFrequency));
        }
        let supply = speed.map_or(motor.line_frequency, |speed| motor.supply_frequency(speed));
        let mut lines = Lines::new(self.machine, table, owner, motor.shaft, speed.ok());
        if let Some(supply) = supply {
            for harmonic in 1..=2 {
                let kind = if motor.synchronous {
                    LineKind::SynchronousPole { harmonic }
                } else {
                    LineKind::Mains { harmonic }
                };
                lines.push(kind, Hz(f64::from(harmonic) * supply.0));
            }
        }
        match speed {
            Ok(speed) => {
                if let Some(pole_pass) = motor.pole_pass_frequency(speed) {
                    lines.push(LineKind::PolePass, pole_pass);
                }
            }
            Err(reason) => table.unlisted.push((owner, reason)),
        }
    }
}

/// Adds the lines of one owner to a table.
struct Lines<'t> {
    table: &'t mut FrequencyTable,
    owner: Owner,
    owner_id: String,
    shaft: ShaftIndex,
    shaft_speed: Option<Hz>,
    band: RelativeBand,
}

impl<'t> Lines<'t> {
    fn new(
        machine: &Machine,
        table: &'t mut FrequencyTable,
        owner: Owner,
        shaft: ShaftIndex,
        shaft_speed: Option<Hz>,
    ) -> Self {
        let band = RelativeBand::default();
        Self { table, owner, owner_id: owner.id(machine), shaft, shaft_speed, band }
    }

    /// Sets the limits of the lines added next.
    fn within(&mut self, band: RelativeBand) -> &mut Self {
        self.band = band;
        self
    }

    /// Adds a line; one at 0 Hz or beyond number range is none (a lower side band of one tooth,
    /// the pole pass of a motor without slip).
    fn push(&mut self, kind: LineKind, frequency: Hz) {
        if !(frequency.0.is_finite() && frequency.0 > 0.0) {
            return;
        }
        self.table.lines.push(FrequencyLine {
            owner: self.owner,
            owner_id: self.owner_id.clone(),
            kind,
            frequency,
            order: self.shaft_speed.and_then(|speed| frequency.order_of(speed)),
            band: self.band,
            shaft: self.shaft,
        });
    }
}

#[cfg(test)]
mod tests;
