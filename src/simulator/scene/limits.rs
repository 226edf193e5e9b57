//! Sizes that faults of teeth may have, in a scene's file and in a scenario alike.

/// Thickest layer worn off a flank, and largest slope, form and offset, m.
pub const TOOTH_M: f64 = 0.01;

/// Factor on the stiffness of a worn tooth's pair.
pub const STIFFNESS_FACTOR: (f64, f64) = (0.01, 1.0);

/// Deepest crack, m.
pub const CRACK_M: f64 = 0.1;

/// Angle of a crack to the centre line of its tooth, degrees.
pub const CRACK_DEG: (f64, f64) = (0.0, 90.0);

/// The same unless given, degrees.
pub const CRACK_DEFAULT_DEG: f64 = 60.0;
