//! Names and seeds, which several sections have: one rule for each.

use artefact::sections::Fault;

use super::MAX_SEED;
use crate::names::{is_allowed, is_name};

/// Refuses a name that is not fit for a folder.
pub(super) fn checked_name(place: &str, name: &str) -> Result<(), Fault> {
    if !is_name(name) {
        let better: String =
            name.to_lowercase().chars().map(|c| if is_allowed(c) { c } else { '-' }).take(64).collect();
        let better = better.trim_matches('-');
        let better = if better.is_empty() { "experiment" } else { better };
        return Err(Fault::new(
            place,
            format!("not 1 to 64 letters a-z, digits, - and _, beginning without -, got {name:?}"),
            match place {
                "name" => format!("write `name = \"{better}\"`"),
                _ => format!("call it `{better}`"),
            },
        ));
    }
    Ok(())
}

/// Refuses a seed that TOML could not hold.
pub(super) fn checked_seed(place: &str, seed: u64) -> Result<u64, Fault> {
    if seed > MAX_SEED {
        return Err(Fault::new(
            place,
            format!("not between 0 and {MAX_SEED}, got {seed}"),
            "choose a smaller number: integers of TOML end there",
        ));
    }
    Ok(seed)
}
