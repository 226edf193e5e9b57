//! Acts on baselines by the rules that hold whoever does them: not too many, none that was changed, one an
//! operating state.

use super::Act;
use super::BaselineStore;
use super::Held;
use super::StoreError;
use crate::diagnosis::baseline::signed::MAX_BASELINES;
use crate::diagnosis::baseline::signed::Signed;
use std::sync::Arc;

/// Why an act on a baseline was not done; nothing has changed.
#[derive(Debug, thiserror::Error)]
pub enum KeepError {
    /// The store cannot be read or refused.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// As many as may be.
    #[error(
        "there are {MAX_BASELINES} baselines of {machine:?}, as many as may be: remove one first"
    )]
    TooMany {
        /// The machine.
        machine: String,
    },
    /// The machine has none of this id.
    #[error("there is no baseline {id:?} of machine {machine:?}")]
    Unknown {
        /// The machine.
        machine: String,
        /// As asked for.
        id: String,
    },
    /// It is not what was signed.
    #[error("the baseline {id} is not as it was signed and cannot be used: remove it")]
    NotIntact {
        /// Its id.
        id: Arc<str>,
    },
}

/// Stores a baseline and uses it instead of those of its operating state; gives it and their ids.
///
/// # Errors
/// When the machine has too many, or it cannot be stored.
pub fn keep(
    store: &dyn BaselineStore,
    signed: Signed,
    load_bins: &[f64],
) -> Result<(Held, Vec<Arc<str>>), KeepError> {
    let all = store.baselines(&signed.machine)?;
    if all.len() >= MAX_BASELINES {
        return Err(KeepError::TooMany { machine: signed.machine });
    }
    let replaced = replaced_by(&signed, &all, load_bins);
    store.learn(&signed, &replaced)?;
    Ok((Held { signed, is_active: true, is_intact: true }, replaced))
}

/// Uses a baseline of (machine, id) again instead of that of its operating state.
///
/// # Errors
/// When there is none, it is not as it was signed, or that cannot be stored.
pub fn use_again(
    store: &dyn BaselineStore,
    (machine, id): (&str, &str),
    load_bins: &[f64],
    act: &Act<'_>,
) -> Result<Held, KeepError> {
    let unknown = || KeepError::Unknown { machine: machine.to_owned(), id: id.to_owned() };
    let all = store.baselines(machine)?;
    let found = all.iter().find(|held| *held.signed.id == *id).ok_or_else(unknown)?;
    if !found.is_intact {
        return Err(KeepError::NotIntact { id: Arc::clone(&found.signed.id) });
    }
    let replaced = replaced_by(&found.signed, &all, load_bins);
    if !store.activate((machine, id), &replaced, act)? {
        return Err(unknown());
    }
    Ok(Held { is_active: true, ..found.clone() })
}

/// Takes a baseline of (machine, id) away; the audit keeps its id.
///
/// # Errors
/// When there is none, or that cannot be stored.
pub fn take_away(
    store: &dyn BaselineStore,
    (machine, id): (&str, &str),
    act: &Act<'_>,
) -> Result<(), KeepError> {
    if store.remove((machine, id), act)? {
        Ok(())
    } else {
        Err(KeepError::Unknown { machine: machine.to_owned(), id: id.to_owned() })
    }
}

fn replaced_by(signed: &Signed, all: &[Held], load_bins: &[f64]) -> Vec<Arc<str>> {
    let active = all.iter().filter(|held| held.is_active).map(|held| &held.signed);
    signed.replaces(active, load_bins)
}
