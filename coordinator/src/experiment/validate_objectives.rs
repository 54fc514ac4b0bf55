//! The meaning of `search.objectives`.

use evolution::Method;

use super::raw::RawSearchObjective;
use crate::objectives::{Objectives, SearchObjective};
use artefact::sections::Fault;

const KEY: &str = "search.objectives";

/// Checks `search.objectives`: two or three under NSGA-II, the error alone under other methods.
pub(super) fn objectives(raw: Option<&[RawSearchObjective]>, method: Method) -> Result<Objectives, Fault> {
    let several = method == Method::Nsga2;
    let Some(raw) = raw else { return Ok(if several { Objectives::ALL } else { Objectives::ERROR }) };
    let written: Vec<SearchObjective> = raw.iter().map(|&objective| objective.into()).collect();
    let names: Vec<String> = written.iter().map(|objective| format!("\"{}\"", objective.name())).collect();
    let got = format!("[{}]", names.join(", "));
    if let Some(twice) = (1..written.len()).find(|&place| written[..place].contains(&written[place])) {
        let what = format!("each must be named once, got {} twice", names[twice]);
        return Err(Fault::new(KEY, what, "remove one of them"));
    }
    match Objectives::new(&written) {
        None => Err(Fault::new(KEY, format!("\"error\" must be among them, got {got}"), "add it")),
        Some(one) if several && !one.are_several() => Err(Fault::new(
            KEY,
            format!("method nsga2 needs two or three, got {got}"),
            "add \"cost\" or \"size\", or write method = \"ga\"",
        )),
        Some(more) if !several && more.are_several() => Err(Fault::new(
            KEY,
            format!("method {method} has one, \"error\", got {got}"),
            "write method = \"nsga2\", or remove the key",
        )),
        Some(objectives) => Ok(objectives),
    }
}
