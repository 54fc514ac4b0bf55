//! Typed access to the cells of a frame that has its table's form.

use std::time::{Duration, SystemTime};

use polars::prelude::{AnyValue, DataFrame, PolarsError};

use crate::error::Error;
use crate::rows::Counts;

/// One row of a frame. A cell of another type than asked for is an error, a null is `None`.
#[derive(Clone, Copy)]
pub(crate) struct Cells<'a> {
    pub frame: &'a DataFrame,
    pub row: usize,
}

impl<'a> Cells<'a> {
    fn cell(&self, name: &str) -> Result<AnyValue<'a>, Error> {
        Ok(self.frame.column(name)?.get(self.row)?)
    }

    /// The value of a column that is never null.
    pub(crate) fn need<T>(
        &self,
        name: &str,
        get: impl Fn(&Self, &str) -> Result<Option<T>, Error>,
    ) -> Result<T, Error> {
        let missing = || PolarsError::NoData(format!("column {name}: expected a value, got null").into());
        Ok(get(self, name)?.ok_or_else(missing)?)
    }

    pub(crate) fn u32(&self, name: &str) -> Result<Option<u32>, Error> {
        match self.cell(name)? {
            AnyValue::Null => Ok(None),
            AnyValue::UInt32(number) => Ok(Some(number)),
            other => Err(unexpected(name, "u32", &other)),
        }
    }

    pub(crate) fn u64(&self, name: &str) -> Result<Option<u64>, Error> {
        match self.cell(name)? {
            AnyValue::Null => Ok(None),
            AnyValue::UInt64(number) => Ok(Some(number)),
            other => Err(unexpected(name, "u64", &other)),
        }
    }

    /// A number that may be stored as u32 or f64, as genes are.
    pub(crate) fn number(&self, name: &str) -> Result<Option<f64>, Error> {
        match self.cell(name)? {
            AnyValue::Null => Ok(None),
            AnyValue::UInt32(number) => Ok(Some(f64::from(number))),
            AnyValue::Float64(number) => Ok(Some(number)),
            other => Err(unexpected(name, "u32 or f64", &other)),
        }
    }

    pub(crate) fn bool(&self, name: &str) -> Result<Option<bool>, Error> {
        match self.cell(name)? {
            AnyValue::Null => Ok(None),
            AnyValue::Boolean(flag) => Ok(Some(flag)),
            other => Err(unexpected(name, "bool", &other)),
        }
    }

    pub(crate) fn text(&self, name: &str) -> Result<Option<String>, Error> {
        match self.cell(name)? {
            AnyValue::Null => Ok(None),
            AnyValue::String(text) => Ok(Some(text.to_owned())),
            AnyValue::StringOwned(text) => Ok(Some(text.to_string())),
            other => Err(unexpected(name, "text", &other)),
        }
    }

    pub(crate) fn time(&self, name: &str) -> Result<Option<SystemTime>, Error> {
        let milliseconds = match self.cell(name)? {
            AnyValue::Null => return Ok(None),
            AnyValue::Datetime(milliseconds, ..) | AnyValue::DatetimeOwned(milliseconds, ..) => milliseconds,
            other => return Err(unexpected(name, "timestamp", &other)),
        };
        let span = Duration::from_millis(milliseconds.unsigned_abs());
        let time = if milliseconds < 0 {
            SystemTime::UNIX_EPOCH.checked_sub(span)
        } else {
            SystemTime::UNIX_EPOCH.checked_add(span)
        };
        time.map(Some).ok_or_else(|| {
            PolarsError::OutOfBounds(format!("column {name}: no such time, got {milliseconds} ms").into())
                .into()
        })
    }

    /// The counts under `<prefix>object_correct`, `<prefix>category_correct` and `<prefix>queries`; `None` if any
    /// of them is null.
    pub(crate) fn counts(&self, prefix: &str) -> Result<Option<Counts>, Error> {
        let count = |name: &str| self.u32(&format!("{prefix}{name}"));
        let counts = (count("object_correct")?, count("category_correct")?, count("queries")?);
        Ok(match counts {
            (Some(object_correct), Some(category_correct), Some(queries)) => {
                Some(Counts { object_correct, category_correct, queries })
            }
            _ => None,
        })
    }
}

fn unexpected(name: &str, expected: &str, got: &AnyValue) -> Error {
    let message = format!("column {name}: expected {expected}, got {}", got.dtype());
    Error::Frame(PolarsError::SchemaMismatch(message.into()))
}
