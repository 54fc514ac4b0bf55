//! The value of a gene, which may be written as a number or as an interval.
//!
//! Serde's untagged enums would do, but lose the place of a mistake and what was expected there.

use std::fmt;

use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, Error, MapAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};

/// A fixed value, or an interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged, rename = "gene")]
pub enum RawGene {
    Fixed(#[serde(serialize_with = "shortest")] f64),
    Interval(RawInterval),
}

/// The values min, min + step, … max. What is not written has its default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "interval")]
pub struct RawInterval {
    /// Smallest value.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    pub min: Option<f64>,
    /// Largest value: min plus a whole number of steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    pub max: Option<f64>,
    /// Distance of neighbouring values.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    pub step: Option<f64>,
}

/// A whole number without a point, as people write it.
fn shortest<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    let whole = value.fract() == 0.0 && value.abs() < 1e9;
    if whole { serializer.serialize_i64(*value as i64) } else { serializer.serialize_f64(*value) }
}

impl<'de> Deserialize<'de> for RawGene {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct GeneVisitor;
        impl<'de> Visitor<'de> for GeneVisitor {
            type Value = RawGene;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number, or a table such as { min = 1, max = 2, step = 1 }")
            }

            fn visit_f64<E: Error>(self, value: f64) -> Result<Self::Value, E> {
                Ok(RawGene::Fixed(value))
            }

            fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
                Ok(RawGene::Fixed(value as f64))
            }

            fn visit_u64<E: Error>(self, value: u64) -> Result<Self::Value, E> {
                Ok(RawGene::Fixed(value as f64))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                RawInterval::deserialize(MapAccessDeserializer::new(map)).map(RawGene::Interval)
            }
        }
        deserializer.deserialize_any(GeneVisitor)
    }
}
