//! States of an alarm and every transition between them, in the words of ISA-18.2.
//!
//! A [`Position`] has two parts that are decided by one function, [`Position::after`]: how far the
//! alarm's life has come, and whether an operator or the design keeps it silent. Silence never stops
//! the life: what comes and goes behind it is followed and recorded, and a condition that outlasts
//! it must be seen anew.

/// How far an alarm's life has come (ANSI/ISA-18.2, alarm state transition diagram).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum AlarmState {
    /// Condition absent, nothing to acknowledge.
    Normal,
    /// Condition present, nobody has acknowledged it.
    Unacknowledged,
    /// Condition present, acknowledged.
    Acknowledged,
    /// Condition gone before anybody acknowledged it.
    ReturnedUnacknowledged,
    /// Condition gone and acknowledged, but the alarm latches: it waits for its reset.
    Latched,
}

impl AlarmState {
    /// All states, for tables.
    pub const ALL: [Self; 5] = [
        Self::Normal,
        Self::Unacknowledged,
        Self::Acknowledged,
        Self::ReturnedUnacknowledged,
        Self::Latched,
    ];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::Unacknowledged => "unacknowledged",
            Self::Acknowledged => "acknowledged",
            Self::ReturnedUnacknowledged => "returned_unacknowledged",
            Self::Latched => "latched",
        }
    }

    /// Whether the condition is present.
    #[must_use]
    pub fn is_active(self) -> bool {
        matches!(self, Self::Unacknowledged | Self::Acknowledged)
    }

    /// Gives the state after what was observed, or after an act on the alarm itself.
    fn after(self, input: LifeInput, latching: bool) -> Result<Self, Refusal> {
        let at_rest = if latching { Self::Latched } else { Self::Normal };
        Ok(match self {
            Self::Normal => match input {
                LifeInput::Active | LifeInput::Escalated => Self::Unacknowledged,
                LifeInput::Cleared => Self::Normal,
                LifeInput::Acknowledge => return Err(Refusal::NothingToAcknowledge),
                LifeInput::Reset => return Err(Refusal::NotLatched),
            },
            Self::Unacknowledged => match input {
                LifeInput::Active | LifeInput::Escalated => Self::Unacknowledged,
                LifeInput::Cleared => Self::ReturnedUnacknowledged,
                LifeInput::Acknowledge => Self::Acknowledged,
                LifeInput::Reset => return Err(Refusal::StillPresent),
            },
            Self::Acknowledged => match input {
                LifeInput::Active => Self::Acknowledged,
                LifeInput::Escalated => Self::Unacknowledged,
                LifeInput::Cleared => at_rest,
                LifeInput::Acknowledge => return Err(Refusal::NothingToAcknowledge),
                LifeInput::Reset => return Err(Refusal::StillPresent),
            },
            Self::ReturnedUnacknowledged => match input {
                LifeInput::Active | LifeInput::Escalated => Self::Unacknowledged,
                LifeInput::Cleared => Self::ReturnedUnacknowledged,
                LifeInput::Acknowledge => at_rest,
                LifeInput::Reset => return Err(Refusal::NotAcknowledged),
            },
            Self::Latched => match input {
                LifeInput::Active | LifeInput::Escalated => Self::Unacknowledged,
                LifeInput::Cleared => Self::Latched,
                LifeInput::Acknowledge => return Err(Refusal::NothingToAcknowledge),
                LifeInput::Reset => Self::Normal,
            },
        })
    }
}

/// Why an alarm does not ask for attention; a later one outranks an earlier one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Silence {
    /// An operator put it aside for a limited time.
    Shelved,
    /// The design says that it means nothing now.
    Suppressed,
    /// It is under maintenance.
    OutOfService,
}

impl Silence {
    /// All kinds, for tables.
    pub const ALL: [Self; 3] = [Self::Shelved, Self::Suppressed, Self::OutOfService];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Shelved => "shelved",
            Self::Suppressed => "suppressed",
            Self::OutOfService => "out_of_service",
        }
    }
}

/// Everything the transition table knows of an alarm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Position {
    /// How far its life has come.
    pub life: AlarmState,
    /// What keeps it silent.
    pub silence: Option<Silence>,
}

impl Position {
    /// No alarm.
    pub const NORMAL: Self = Self { life: AlarmState::Normal, silence: None };

    /// Whether the alarm is over.
    #[must_use]
    pub fn is_over(self) -> bool {
        self == Self::NORMAL
    }

    /// Gives the position after `input`: the one place where transitions are decided. `latching`: the
    /// alarm keeps its condition until it is reset.
    ///
    /// # Errors
    /// When an operator's act does not fit the position. What is observed always fits.
    pub fn after(self, input: AlarmInput, latching: bool) -> Result<Self, Refusal> {
        let Self { life, silence } = self;
        match input {
            AlarmInput::Life(input) => Ok(Self { life: life.after(input, latching)?, silence }),
            AlarmInput::Silence(wanted) => match silence {
                Some(other) if other > wanted => Err(Refusal::AlreadySilent(other)),
                // Shelving again sets a new time; a stronger silence takes the place of a weaker one.
                Some(Silence::Shelved) | None => Ok(Self { life, silence: Some(wanted) }),
                Some(same) if same == wanted => Err(Refusal::AlreadySilent(same)),
                Some(Silence::Suppressed | Silence::OutOfService) => {
                    Ok(Self { life, silence: Some(wanted) })
                }
            },
            AlarmInput::EndOf(ended) if silence == Some(ended) => {
                let seen_anew = life == AlarmState::Acknowledged;
                let life = if seen_anew { AlarmState::Unacknowledged } else { life };
                Ok(Self { life, silence: None })
            }
            AlarmInput::EndOf(ended) => Err(Refusal::NotSilent(ended)),
            AlarmInput::Removed => Ok(Self::NORMAL),
        }
    }

    /// What an operator sees.
    #[must_use]
    pub fn shown(self) -> ShownState {
        match (self.silence, self.life) {
            (Some(Silence::Shelved), _) => ShownState::Shelved,
            (Some(Silence::Suppressed), _) => ShownState::Suppressed,
            (Some(Silence::OutOfService), _) => ShownState::OutOfService,
            (None, AlarmState::Normal) => ShownState::Normal,
            (None, AlarmState::Unacknowledged) => ShownState::Unacknowledged,
            (None, AlarmState::Acknowledged) => ShownState::Acknowledged,
            (None, AlarmState::ReturnedUnacknowledged) => ShownState::ReturnedUnacknowledged,
            (None, AlarmState::Latched) => ShownState::Latched,
        }
    }
}

/// State of an alarm as an operator sees it: its silence, else its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ShownState {
    /// See [`AlarmState::Normal`].
    Normal,
    /// See [`AlarmState::Unacknowledged`].
    Unacknowledged,
    /// See [`AlarmState::Acknowledged`].
    Acknowledged,
    /// See [`AlarmState::ReturnedUnacknowledged`].
    ReturnedUnacknowledged,
    /// See [`AlarmState::Latched`].
    Latched,
    /// See [`Silence::Shelved`].
    Shelved,
    /// See [`Silence::Suppressed`].
    Suppressed,
    /// See [`Silence::OutOfService`].
    OutOfService,
}

impl ShownState {
    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal => AlarmState::Normal.name(),
            Self::Unacknowledged => AlarmState::Unacknowledged.name(),
            Self::Acknowledged => AlarmState::Acknowledged.name(),
            Self::ReturnedUnacknowledged => AlarmState::ReturnedUnacknowledged.name(),
            Self::Latched => AlarmState::Latched.name(),
            Self::Shelved => Silence::Shelved.name(),
            Self::Suppressed => Silence::Suppressed.name(),
            Self::OutOfService => Silence::OutOfService.name(),
        }
    }
}

/// What moves an alarm's life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LifeInput {
    /// The condition is present, at the level known or below.
    Active,
    /// The condition is present at a higher level than acknowledged: it must be seen again.
    Escalated,
    /// The condition is gone.
    Cleared,
    /// An operator acknowledges.
    Acknowledge,
    /// An operator resets a latched alarm.
    Reset,
}

impl LifeInput {
    /// All inputs, for tables.
    pub const ALL: [Self; 5] =
        [Self::Active, Self::Escalated, Self::Cleared, Self::Acknowledge, Self::Reset];
}

/// What can happen to an alarm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlarmInput {
    /// Its life moves.
    Life(LifeInput),
    /// It is silenced.
    Silence(Silence),
    /// A silence ends, by an operator or, of a shelved alarm, by time.
    EndOf(Silence),
    /// What it is about is no longer configured: nobody will ever judge it again.
    Removed,
}

/// Why an act does not fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// It is acknowledged, or there is nothing to acknowledge.
    NothingToAcknowledge,
    /// Its condition must be acknowledged before it can be reset.
    NotAcknowledged,
    /// It does not wait for a reset.
    NotLatched,
    /// Its condition is present.
    StillPresent,
    /// It is silent already, for this reason.
    AlreadySilent(Silence),
    /// It is not silent for this reason.
    NotSilent(Silence),
}

#[cfg(test)]
mod tests {
    use super::*;
    use AlarmState::{
        Acknowledged as A, Latched as L, Normal as N, ReturnedUnacknowledged as R,
        Unacknowledged as U,
    };
    use Refusal::{NotAcknowledged, NotLatched, NothingToAcknowledge, StillPresent};

    fn silences() -> impl Iterator<Item = Option<Silence>> {
        std::iter::once(None).chain(Silence::ALL.into_iter().map(Some))
    }

    fn inputs() -> Vec<AlarmInput> {
        let silences = Silence::ALL.into_iter();
        let life = LifeInput::ALL.into_iter().map(AlarmInput::Life);
        life.chain(silences.clone().map(AlarmInput::Silence))
            .chain(silences.map(AlarmInput::EndOf))
            .chain([AlarmInput::Removed])
            .collect()
    }

    #[test]
    fn every_state_and_input_of_a_life_has_its_place_in_the_table() {
        const NONE: Result<AlarmState, Refusal> = Err(NothingToAcknowledge);
        // Rows: state; columns: Active, Escalated, Cleared, Acknowledge, Reset.
        let table = [
            (N, false, [Ok(U), Ok(U), Ok(N), NONE, Err(NotLatched)]),
            (U, false, [Ok(U), Ok(U), Ok(R), Ok(A), Err(StillPresent)]),
            (A, false, [Ok(A), Ok(U), Ok(N), NONE, Err(StillPresent)]),
            (R, false, [Ok(U), Ok(U), Ok(R), Ok(N), Err(NotAcknowledged)]),
            (L, false, [Ok(U), Ok(U), Ok(L), NONE, Ok(N)]),
            (N, true, [Ok(U), Ok(U), Ok(N), NONE, Err(NotLatched)]),
            (U, true, [Ok(U), Ok(U), Ok(R), Ok(A), Err(StillPresent)]),
            (A, true, [Ok(A), Ok(U), Ok(L), NONE, Err(StillPresent)]),
            (R, true, [Ok(U), Ok(U), Ok(R), Ok(L), Err(NotAcknowledged)]),
            (L, true, [Ok(U), Ok(U), Ok(L), NONE, Ok(N)]),
        ];
        for (life, latching, row) in table {
            for (input, expected) in LifeInput::ALL.into_iter().zip(row) {
                for silence in silences() {
                    // Silence neither moves a life nor is moved by it.
                    let found = Position { life, silence }.after(AlarmInput::Life(input), latching);
                    let expected = expected.map(|life| Position { life, silence });
                    assert_eq!(found, expected, "{life:?} {silence:?} {latching} after {input:?}");
                }
            }
        }
        assert_eq!(table.map(|(life, ..)| life)[..5], AlarmState::ALL);
    }

    #[test]
    fn every_silence_and_input_has_its_place_in_the_table() {
        use Refusal::{AlreadySilent, NotSilent};
        use Silence::{OutOfService as O, Shelved as S, Suppressed as D};
        let (is, no) = (|s| Ok(Some(s)), |s| Err(NotSilent(s)));
        // Rows: silence; columns: shelve, suppress, take out of service; end of each.
        let table = [
            (None, [is(S), is(D), is(O)], [no(S), no(D), no(O)]),
            (Some(S), [is(S), is(D), is(O)], [Ok(None), no(D), no(O)]),
            (
                Some(D),
                [Err(AlreadySilent(D)), Err(AlreadySilent(D)), is(O)],
                [no(S), Ok(None), no(O)],
            ),
            (Some(O), [Err(AlreadySilent(O)); 3], [no(S), no(D), Ok(None)]),
        ];
        for (silence, begins, ends) in table {
            for life in AlarmState::ALL {
                for (wanted, expected) in Silence::ALL.into_iter().zip(begins) {
                    let found =
                        Position { life, silence }.after(AlarmInput::Silence(wanted), false);
                    let expected = expected.map(|silence| Position { life, silence });
                    assert_eq!(found, expected, "{silence:?} silenced by {wanted:?}");
                }
                for (ended, expected) in Silence::ALL.into_iter().zip(ends) {
                    let found = Position { life, silence }.after(AlarmInput::EndOf(ended), false);
                    // What was acknowledged before must be seen anew.
                    let life = if life == A { U } else { life };
                    let expected = expected.map(|silence| Position { life, silence });
                    assert_eq!(found, expected, "{silence:?} after the end of {ended:?}");
                }
            }
        }
        assert_eq!(table.map(|(silence, ..)| silence).to_vec(), silences().collect::<Vec<_>>());
    }

    #[test]
    fn a_present_condition_is_never_normal_and_only_its_going_ends_it() {
        for (life, latching) in AlarmState::ALL.into_iter().flat_map(|l| [(l, false), (l, true)]) {
            for silence in silences() {
                let position = Position { life, silence };
                for input in inputs() {
                    let Ok(after) = position.after(input, latching) else {
                        assert!(
                            !matches!(
                                input,
                                AlarmInput::Life(
                                    LifeInput::Active | LifeInput::Escalated | LifeInput::Cleared
                                )
                            ),
                            "what is observed is never refused"
                        );
                        continue;
                    };
                    match input {
                        AlarmInput::Life(LifeInput::Active | LifeInput::Escalated) => {
                            assert!(after.life.is_active());
                        }
                        AlarmInput::Life(LifeInput::Cleared) => assert!(!after.life.is_active()),
                        AlarmInput::Removed => assert!(after.is_over()),
                        AlarmInput::Life(LifeInput::Acknowledge | LifeInput::Reset)
                        | AlarmInput::Silence(_)
                        | AlarmInput::EndOf(_) => {
                            assert_eq!(after.life.is_active(), life.is_active(), "{input:?}");
                        }
                    }
                    assert!(!after.is_over() || after.shown() == ShownState::Normal);
                }
            }
        }
    }
}
