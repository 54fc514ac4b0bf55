//! Values that may be written in more than one form: number or word, number or interval, word or table.
//!
//! Serde's untagged enums would do, but lose the place of a mistake and what was expected there.

use std::fmt;
use std::marker::PhantomData;

use schemars::JsonSchema;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, Error, IntoDeserializer, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Serialize};

/// Which cloud is in which split: the manifest's column, lists, or a random draw.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(untagged, rename = "splits")]
pub(super) enum RawSplits {
    Word(RawSplitWord),
    Table(Box<RawSplitTable>),
}

/// Splits by one word.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "split_word")]
pub(super) enum RawSplitWord {
    /// The column `split` of the manifest.
    Manifest,
}

/// Splits by lists (one path a line, relative to root) or, with `seeded`, by a random draw.
#[derive(Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "split_table")]
pub(super) struct RawSplitTable {
    /// List of the queries of the fitness, or several lists; a relative path is relative to root. Default: train1.txt
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawLists", example = &"train1.txt")]
    pub train1: Option<RawLists>,
    /// List of the database of the fitness, or several; relative to root. Default: train2.txt
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawLists", example = example_lists())]
    pub train2: Option<RawLists>,
    /// List of the queries against train1 and train2 that may stop the search and choose the winner, or several; relative
    /// to root. None at all, `[]`, with search.winner = "fitness" and stop.validation_patience = "off". Default:
    /// validation.txt
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawLists", example = &"validation.txt")]
    pub validation: Option<RawLists>,
    /// List of the queries of the final test, against the other three, or several; relative to root. Default: test.txt
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawLists", example = &"test.txt")]
    pub test: Option<RawLists>,
    /// Draw the splits instead of reading lists.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawSeeded")]
    pub seeded: Option<RawSeeded>,
}

/// A random draw of the splits from all clouds. Shares are of the clouds that are drawn from; what is left over
/// is not used.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "seeded")]
pub(super) struct RawSeeded {
    /// Seed of the draw; the run's own seed has no part in it.
    #[schemars(range(min = 0, max = 9_223_372_036_854_775_807_i64))]
    pub seed: u64,
    /// Share of train1.
    #[schemars(range(min = 0, max = 1))]
    pub train1: f64,
    /// Share of train2.
    #[schemars(range(min = 0, max = 1))]
    pub train2: f64,
    /// Share of validation.
    #[schemars(range(min = 0, max = 1))]
    pub validation: f64,
    /// Share of test. Default: what the other three leave, or 0 with test_sequences.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64", range(min = 0, max = 1))]
    pub test: Option<f64>,
    /// Draw within each instance, so that each has its share in each split.
    pub stratified: bool,
    /// Sequences whose clouds are the test split (in the UW layout: numbers of videos); the other clouds are
    /// drawn for the other splits.
    #[schemars(example = example_sequences())]
    pub test_sequences: Vec<String>,
}

fn example_sequences() -> [&'static str; 1] {
    ["2"]
}

fn example_lists() -> [&'static str; 2] {
    ["train2.txt", "more.txt"]
}

impl Default for RawSeeded {
    fn default() -> Self {
        Self {
            seed: 1,
            train1: 0.25,
            train2: 0.25,
            validation: 0.17,
            test: None,
            stratified: true,
            test_sequences: Vec::new(),
        }
    }
}

/// The list of a split, or several.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[serde(untagged, rename = "lists")]
pub(super) enum RawLists {
    One(String),
    Several(Vec<String>),
}

impl RawLists {
    /// As they are written.
    pub(super) fn paths(self) -> Vec<String> {
        match self {
            Self::One(path) => vec![path],
            Self::Several(paths) => paths,
        }
    }
}

impl fmt::Display for RawLists {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::One(path) => write!(f, "{path:?}"),
            Self::Several(paths) => write!(f, "{paths:?}"),
        }
    }
}

/// Seeds: all between two of them, or a list.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[serde(untagged, rename = "seeds")]
pub(super) enum RawSeeds {
    Range(String),
    List(Vec<u64>),
}

/// A whole number or a word.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "number_or_{W}")]
pub(super) enum NumberOr<W> {
    Number(u32),
    Word(W),
}

/// The one word that may stand for a number.
pub(super) trait Word: Default {
    /// The word as written.
    const TEXT: &'static str;
}

impl<'de, W: Word> Deserialize<'de> for NumberOr<W> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NumberOrVisitor<W>(PhantomData<W>);
        impl<W: Word> Visitor<'_> for NumberOrVisitor<W> {
            type Value = NumberOr<W>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a whole number from 0 to {} or \"{}\"", u32::MAX, W::TEXT)
            }

            fn visit_u64<E: Error>(self, number: u64) -> Result<Self::Value, E> {
                u32::try_from(number)
                    .map(NumberOr::Number)
                    .map_err(|_| E::invalid_value(Unexpected::Unsigned(number), &self))
            }

            fn visit_i64<E: Error>(self, number: i64) -> Result<Self::Value, E> {
                u32::try_from(number)
                    .map(NumberOr::Number)
                    .map_err(|_| E::invalid_value(Unexpected::Signed(number), &self))
            }

            fn visit_str<E: Error>(self, word: &str) -> Result<Self::Value, E> {
                if word == W::TEXT {
                    Ok(NumberOr::Word(W::default()))
                } else {
                    Err(E::invalid_value(Unexpected::Str(word), &self))
                }
            }
        }
        deserializer.deserialize_any(NumberOrVisitor(PhantomData))
    }
}

impl<'de> Deserialize<'de> for RawSeeds {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct SeedsVisitor;
        impl<'de> Visitor<'de> for SeedsVisitor {
            type Value = RawSeeds;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("two seeds such as \"1..20\", or a list of seeds")
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
                Ok(RawSeeds::Range(text.to_owned()))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Self::Value, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(seq)).map(RawSeeds::List)
            }
        }
        deserializer.deserialize_any(SeedsVisitor)
    }
}

impl<'de> Deserialize<'de> for RawLists {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct ListsVisitor;
        impl<'de> Visitor<'de> for ListsVisitor {
            type Value = RawLists;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the path of a list, or paths of several such as [\"train2.txt\", \"more.txt\"]")
            }

            fn visit_str<E: Error>(self, path: &str) -> Result<Self::Value, E> {
                Ok(RawLists::One(path.to_owned()))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Self::Value, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(seq)).map(RawLists::Several)
            }
        }
        deserializer.deserialize_any(ListsVisitor)
    }
}

impl<'de> Deserialize<'de> for RawSplits {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct SplitsVisitor;
        impl<'de> Visitor<'de> for SplitsVisitor {
            type Value = RawSplits;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"manifest\", or a table of lists, or a table with `seeded`")
            }

            fn visit_str<E: Error>(self, word: &str) -> Result<Self::Value, E> {
                RawSplitWord::deserialize(word.into_deserializer()).map(RawSplits::Word)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                RawSplitTable::deserialize(MapAccessDeserializer::new(map))
                    .map(|table| RawSplits::Table(Box::new(table)))
            }
        }
        deserializer.deserialize_any(SplitsVisitor)
    }
}
