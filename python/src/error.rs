//! Errors of the library as `descry.Error`.

use std::fmt::Display;

use proto::Message;
use pyo3::prelude::*;

/// `descry.Error` with what went wrong and what to do; what Python says instead if the package is not whole.
pub fn raised(error: impl Display) -> PyErr {
    let Message { what, advice } = Message::of(&error);
    Python::attach(|py| {
        let made = || py.import("descry.errors")?.getattr("Error")?.call1((what, advice));
        match made() {
            Ok(error) => PyErr::from_value(error),
            Err(error) => error,
        }
    })
}
