//! One value of an answer: what polars holds, as text, CSV and JSON know it.

use std::borrow::Cow;

use artefact::text::hex;
use polars::prelude::{AnyValue, Series, TimeUnit};
use serde::ser::{Serialize, Serializer};

/// One value.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cell<'a> {
    Null,
    Bool(bool),
    Integer(i128),
    /// Kept apart, because it has fewer digits.
    Single(f32),
    Float(f64),
    Text(Cow<'a, str>),
    List(Vec<Cell<'static>>),
}

impl<'a> Cell<'a> {
    pub(super) fn of(column: &'a Series, row: usize) -> Self {
        column.get(row).map_or(Self::Null, Self::from)
    }

    /// Its text, with all digits; NULL has none.
    pub(super) fn plain(&self) -> Cow<'_, str> {
        match self {
            Self::Null => Cow::Borrowed(""),
            Self::Bool(value) => Cow::Borrowed(if *value { "true" } else { "false" }),
            Self::Integer(value) => Cow::Owned(value.to_string()),
            // The shortest text that is read back as the same number.
            Self::Single(value) => Cow::Owned(format!("{value:?}")),
            Self::Float(value) => Cow::Owned(format!("{value:?}")),
            Self::Text(text) => Cow::Borrowed(text),
            Self::List(_) => Cow::Owned(serde_json::to_string(self).unwrap_or_default()),
        }
    }

    fn into_owned(self) -> Cell<'static> {
        match self {
            Self::Null => Cell::Null,
            Self::Bool(value) => Cell::Bool(value),
            Self::Integer(value) => Cell::Integer(value),
            Self::Single(value) => Cell::Single(value),
            Self::Float(value) => Cell::Float(value),
            Self::Text(text) => Cell::Text(Cow::Owned(text.into_owned())),
            Self::List(cells) => Cell::List(cells),
        }
    }
}

impl<'a> From<AnyValue<'a>> for Cell<'a> {
    fn from(value: AnyValue<'a>) -> Self {
        match value {
            AnyValue::Null => Self::Null,
            AnyValue::Boolean(value) => Self::Bool(value),
            AnyValue::String(text) => Self::Text(Cow::Borrowed(text)),
            AnyValue::StringOwned(text) => Self::Text(Cow::Owned(text.to_string())),
            AnyValue::Float32(value) => Self::Single(value),
            AnyValue::Float64(value) => Self::Float(value),
            AnyValue::Datetime(value, unit, _) => time(value, unit),
            AnyValue::DatetimeOwned(value, unit, _) => time(value, unit),
            AnyValue::Duration(value, unit) => Self::Float(value as f64 / a_second(unit) as f64),
            AnyValue::Decimal(..) => value.extract::<f64>().map_or(Self::Null, Self::Float),
            AnyValue::List(cells) | AnyValue::Array(cells, _) => {
                Self::List(cells.iter().map(|value| Cell::from(value).into_owned()).collect())
            }
            AnyValue::Binary(bytes) => Self::Text(Cow::Owned(hex(bytes))),
            AnyValue::BinaryOwned(bytes) => Self::Text(Cow::Owned(hex(&bytes))),
            value if value.is_integer() => value.extract::<i128>().map_or(Self::Null, Self::Integer),
            value => Self::Text(Cow::Owned(value.to_string())),
        }
    }
}

fn a_second(unit: TimeUnit) -> i64 {
    match unit {
        TimeUnit::Nanoseconds => 1_000_000_000,
        TimeUnit::Microseconds => 1_000_000,
        TimeUnit::Milliseconds => 1000,
    }
}

/// ISO 8601. A time beyond the calendar, as arithmetic can make it, stays a number: polars panics on it.
fn time(value: i64, unit: TimeUnit) -> Cell<'static> {
    const YEARS: i64 = 200_000 * 366 * 86_400;
    if (value / a_second(unit)).abs() > YEARS {
        return Cell::Integer(value.into());
    }
    let text = AnyValue::Datetime(value, unit, None).to_string();
    Cell::Text(Cow::Owned(format!("{}Z", text.replacen(' ', "T", 1))))
}

impl Serialize for Cell<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Null => serializer.serialize_unit(),
            Self::Bool(value) => serializer.serialize_bool(*value),
            Self::Integer(value) => match (i64::try_from(*value), u64::try_from(*value)) {
                (Ok(value), _) => serializer.serialize_i64(value),
                (_, Ok(value)) => serializer.serialize_u64(value),
                _ => serializer.serialize_i128(*value),
            },
            Self::Single(value) => serializer.serialize_f32(*value),
            Self::Float(value) => serializer.serialize_f64(*value),
            Self::Text(text) => serializer.serialize_str(text),
            Self::List(cells) => serializer.collect_seq(cells),
        }
    }
}
