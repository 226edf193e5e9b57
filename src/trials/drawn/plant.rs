//! The machine and how it is recorded (T8), and the machine file that a user would write for it.

use super::log_uniform;
use crate::machine::Machine;
use crate::machine::bearing::Bearing;
use crate::machine::bearing::FaultOrders;
use crate::machine::file;
use crate::machine::file::MachineFileErrors;
use crate::trials::motion::Motion;
use crate::trials::motion::SLOW_SWING_S;
use crate::trials::motion::Turn;
use crate::units::Hz;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::fmt;
use std::fmt::Write as _;
use std::sync::Arc;

/// The bearing that is damaged: the first sensor sits on it.
pub const DAMAGED: &str = "b0";

/// Channel of the tacho.
pub const TACHO: &str = "tacho";

/// Sampling rates of common recorders, Hz.
const RATES_HZ: [f64; 17] = [
    5000.0, 6400.0, 8192.0, 10_240.0, 12_000.0, 12_800.0, 20_000.0, 20_480.0, 25_600.0, 42_000.0,
    48_828.0, 50_000.0, 51_200.0, 64_000.0, 97_656.0, 102_400.0, 200_000.0,
];

/// Samples at most.
const MAX_SAMPLES: f64 = 800_000.0;

/// A record shorter than this has its speed written down or a tacho, s: no signal tells it better than 1/T.
const TELLS_SPEED_S: f64 = 2.0;

/// What kind of machine it is, and what is recorded of such.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Mills, mixers, wind turbines.
    Slow,
    /// Motors, pumps, fans.
    Usual,
    /// Spindles, compressors, turbines.
    Fast,
    /// As usual, with bearings of one type.
    Alike,
    /// As usual, of a speed that swings within a few revolutions: reciprocating loads, couplings, controllers that hunt.
    Swinging,
}

impl Kind {
    /// Name of its trials in tables.
    #[must_use]
    pub fn group(self) -> &'static str {
        match self {
            Self::Slow => "drawn, slow",
            Self::Usual => "drawn",
            Self::Fast => "drawn, fast",
            Self::Alike => "drawn, alike",
            Self::Swinging => "drawn, swinging",
        }
    }

    /// Speeds, Hz.
    fn speed_hz(self) -> (f64, f64) {
        match self {
            Self::Slow => (0.5, 8.0),
            Self::Usual | Self::Alike | Self::Swinging => (8.0, 50.0),
            Self::Fast => (50.0, 500.0),
        }
    }

    /// Lengths, s.
    fn duration_s(self) -> (f64, f64) {
        match self {
            Self::Slow => (20.0, 100.0),
            Self::Usual | Self::Fast | Self::Alike | Self::Swinging => (1.0, 20.0),
        }
    }

    /// Sampling rates, Hz: slow machines up to 12.8 kHz, fast ones from 42 kHz on.
    fn rates_hz(self) -> &'static [f64] {
        match self {
            Self::Slow => &RATES_HZ[..6],
            Self::Usual | Self::Alike | Self::Swinging => &RATES_HZ,
            Self::Fast => &RATES_HZ[9..],
        }
    }

    /// Bearings at least and at most.
    fn n_bearings(self) -> (usize, usize) {
        match self {
            Self::Slow | Self::Usual | Self::Fast | Self::Swinging => (1, 2),
            Self::Alike => (2, 4),
        }
    }
}

/// How far a speed beside the record, and one on a name plate, may be off, relative.
const WRITTEN: f64 = 0.003;
const NAME_PLATE: f64 = 0.02;

/// Pitch diameter of all bearings, mm: only ratios matter.
const PITCH_MM: f64 = 50.0;

/// What is known of the speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Told {
    /// Written beside the record.
    Written,
    /// On the name plate alone.
    NamePlate,
    /// By a tacho.
    Tacho,
}

impl Told {
    fn draw(duration_s: f64, random: &mut Pcg64Mcg) -> Self {
        let drawn = random.random_range(0.0..1.0);
        match drawn {
            ..0.45 => Self::Written,
            ..0.7 if duration_s > TELLS_SPEED_S => Self::NamePlate,
            ..0.7 => Self::Written,
            _ => Self::Tacho,
        }
    }
}

/// A machine, and a record's frame.
#[derive(Debug, Clone)]
pub struct Plant {
    /// The machine as its file has it.
    pub machine: Arc<Machine>,
    /// That file's text.
    pub machine_text: Arc<str>,
    /// Sampling rate.
    pub rate: Hz,
    /// How the shaft turns.
    pub turn: Turn,
    /// Revolutions turned at each sample.
    pub turned: Vec<f64>,
    /// Accelerometers: one on each bearing, perhaps one elsewhere.
    pub n_sensors: usize,
    /// What is known of the speed.
    pub told: Told,
    /// The speed that is written beside the record.
    pub written: Option<Hz>,
    /// Frequency of the mains, if the machine file lists a motor.
    pub line_hz: Option<f64>,
}

impl Plant {
    /// Draws a machine (T8).
    ///
    /// # Errors
    /// Never, as long as what is drawn makes a machine file.
    pub fn draw(kind: Kind, random: &mut Pcg64Mcg) -> Result<Self, MachineFileErrors> {
        let rates_hz = kind.rates_hz();
        let rate = Hz(rates_hz[random.random_range(0..rates_hz.len())]);
        let drawn_s = log_uniform(kind.duration_s(), random);
        let n_samples = crate::dsp::real::floor_index((drawn_s * rate.0).min(MAX_SAMPLES));
        let duration_s = n_samples as f64 / rate.0;
        let speed_hz = log_uniform(kind.speed_hz(), random);
        let told = Told::draw(duration_s, random);
        let motion = match kind {
            Kind::Swinging => swing(speed_hz, random),
            Kind::Slow | Kind::Usual | Kind::Fast | Kind::Alike => motion(told, random),
        };
        let turn = Turn::draw(motion, speed_hz, duration_s, random);
        let turned: Vec<f64> =
            (0..n_samples).map(|i| turn.revolutions(i as f64 / rate.0)).collect();
        let mean_hz = turn.revolutions(duration_s) / duration_s;
        let (fewest, most) = kind.n_bearings();
        let n_bearings = random.random_range(fewest..=most);
        let n_sensors = n_bearings + usize::from(random.random_bool(0.3));
        let mains_hz = if random.random_bool(0.5) { 50.0 } else { 60.0 };
        let line_hz = random.random_bool(0.7).then_some(mains_hz);
        let plate_hz = mean_hz * (1.0 + random.random_range(-NAME_PLATE..NAME_PLATE));
        let text = text(plate_hz, line_hz, (kind, n_bearings, n_sensors), told, random);
        let written = mean_hz * (1.0 + random.random_range(-WRITTEN..WRITTEN));
        Ok(Self {
            machine: Arc::new(file::parse(&text, "drawn")?),
            machine_text: text.into(),
            rate,
            turn,
            turned,
            n_sensors,
            told,
            written: (told == Told::Written).then_some(Hz(written)),
            line_hz,
        })
    }

    /// Length, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.turned.len() as f64 / self.rate.0
    }

    /// Fault orders of the bearing that may be damaged.
    #[must_use]
    pub fn fault_orders(&self) -> Option<FaultOrders> {
        self.machine.bearings.first().and_then(Bearing::fault_orders)
    }

    /// Mean speed.
    #[must_use]
    pub fn mean_speed(&self) -> Hz {
        Hz(self.turn.revolutions(self.duration_s()) / self.duration_s())
    }
}

impl fmt::Display for Plant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let told = match self.told {
            Told::Written => "written",
            Told::NamePlate => "name plate",
            Told::Tacho => "tacho",
        };
        let (rate_hz, speed_hz) = (self.rate.0, self.mean_speed().0);
        write!(f, "{rate_hz} Hz, {:.2} s, shaft {speed_hz:.3} Hz by {told}", self.duration_s())?;
        for bearing in &self.machine.bearings {
            let Some(orders) = bearing.fault_orders() else { continue };
            let (o, i) = (orders.bpfo, orders.bpfi);
            write!(f, ", {} {o:.3} {i:.3} {:.3} {:.3}", bearing.id, orders.two_bsf(), orders.ftf)?;
        }
        Ok(())
    }
}

/// How far a speed swings that does so within a few revolutions, relative, and within how many.
const SWINGS_BY: (f64, f64) = (0.002, 0.05);
const SWING_REVOLUTIONS: (f64, f64) = (3.0, 40.0);

fn swing(speed_hz: f64, random: &mut Pcg64Mcg) -> Motion {
    let depth = log_uniform(SWINGS_BY, random);
    Motion::Swing(depth, log_uniform(SWING_REVOLUTIONS, random) / speed_hz)
}

fn motion(told: Told, random: &mut Pcg64Mcg) -> Motion {
    let wanders = match told {
        Told::Tacho if random.random_bool(0.5) => {
            let depth = random.random_range(0.015..0.15);
            return if random.random_bool(0.5) {
                Motion::Swing(depth, SLOW_SWING_S)
            } else {
                Motion::Ramp(1.0 - depth, 1.0 + depth)
            };
        }
        Told::Tacho => [0.0, 1e-3, 3e-3, 1e-3, 0.0],
        Told::Written | Told::NamePlate => [0.0, 0.0, 2e-4, 5e-4, 1e-3],
    };
    match wanders[random.random_range(0..wanders.len())] {
        0.0 => Motion::Steady,
        deviation => Motion::Wander(deviation),
    }
}

/// Channel of the accelerometer of this number.
#[must_use]
pub fn channel(sensor: usize) -> String {
    format!("a{sensor}")
}

/// What a machine file says of a bearing's inside.
fn geometry(random: &mut Pcg64Mcg) -> String {
    let elements = random.random_range(7..=19_u32);
    let most = (2.4 / f64::from(elements)).min(0.32);
    let element_mm = PITCH_MM * random.random_range(0.12..most.max(0.125));
    let angle_deg = if random.random_bool(0.6) { 0.0 } else { random.random_range(5.0..40.0) };
    format!(
        "elements = {elements}\nelement_diameter_mm = {element_mm:?}\npitch_diameter_mm = {PITCH_MM:?}\n\
         contact_angle_deg = {angle_deg:?}\n"
    )
}

/// The machine file.
fn text(
    plate_hz: f64,
    line_hz: Option<f64>,
    (kind, n_bearings, n_sensors): (Kind, usize, usize),
    told: Told,
    random: &mut Pcg64Mcg,
) -> String {
    let mut text = format!(
        "[machine]\nid = \"drawn\"\nname = \"Drawn\"\n[[shaft]]\nid = \"main\"\nspeed_hz = {plate_hz:?}\n"
    );
    // Writing to a String does not fail.
    if let Some(line_hz) = line_hz {
        let poles = if random.random_bool(0.5) { 2 } else { 4 };
        let _ = write!(
            text,
            "[[motor]]\nshaft = \"main\"\npoles = {poles}\nline_frequency_hz = {line_hz:?}\n"
        );
    }
    let mut inside = geometry(random);
    for bearing in 0..n_bearings {
        if bearing > 0 && kind != Kind::Alike {
            inside = geometry(random);
        }
        let _ = write!(text, "[[bearing]]\nid = \"b{bearing}\"\nshaft = \"main\"\n{inside}");
    }
    for sensor in 0..n_sensors {
        let at = if sensor < n_bearings {
            format!("bearing = \"b{sensor}\"")
        } else {
            "shaft = \"main\"".to_owned()
        };
        let channel = channel(sensor);
        let _ = write!(
            text,
            "[[sensor]]\nchannel = \"{channel}\"\nkind = \"accelerometer\"\nat = {{ {at} }}\n"
        );
    }
    if told == Told::Tacho {
        let _ = write!(
            text,
            "[[sensor]]\nchannel = \"{TACHO}\"\nkind = \"tacho\"\nat = {{ shaft = \"main\" }}\n"
        );
    }
    text
}
