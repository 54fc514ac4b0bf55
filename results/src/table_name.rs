//! Names of the tables, and which folder has which.

use std::fmt;

macro_rules! table_names {
    ($($(#[$doc:meta])* $name:ident = $text:literal,)*) => {
        /// The tables of run folders, grid folders and artefacts. A table's files lie in the folder of its name.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum TableName {
            $($(#[$doc])* $name,)*
        }

        impl TableName {
            /// Its name: the folder's name and the value of `descry.table` in the files.
            pub fn as_str(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)*
                }
            }
        }
    };
}

table_names! {
    /// One row per individual and generation.
    Evaluations = "evaluations",
    /// One row per generation.
    Generations = "generations",
    /// One row per point of the front of a search of several objectives.
    Front = "front",
    /// One row per query of validation and test.
    Predictions = "predictions",
    /// One row per cloud that was skipped.
    Skipped = "skipped",
    /// One row per worker and registration.
    Workers = "workers",
    /// One row per attempt that has ended.
    Attempts = "attempts",
    /// One row per event.
    Events = "events",
    /// One row per release of test clouds to workers.
    Looks = "looks",
    /// One row: the run itself.
    Run = "run",
    /// One row per descriptor and pair of clouds.
    Distances = "distances",
    /// One row per descriptor and query.
    Answers = "answers",
    /// One row per point of a descriptor's curve.
    RecallPrecision = "recall_precision",
    /// One row per pair of descriptors.
    Pairs = "pairs",
    /// One row per descriptor.
    Comparison = "comparison",
    /// One row per descriptor and perturbation of the test clouds.
    Perturbed = "perturbed",
    /// One row per descriptor and set of clouds.
    Sets = "sets",
    /// One row per descriptor of one cell of the grid.
    Cells = "cells",
    /// One row for each of the best descriptors of the grid.
    Best = "best",
    /// One row per gene and value.
    Marginals = "marginals",
    /// One row per pair of genes and their values.
    Landscapes = "landscapes",
    /// One row per number of correct answers that occurs in the grid.
    Counts = "counts",
    /// One row: the grid itself.
    Grid = "grid",
    /// One row per reference cloud of an artefact, by shape and colour.
    Database = "database",
    /// One row per reference cloud of an artefact, by channels.
    Channels = "channels",
}

impl TableName {
    /// The tables of a run folder.
    pub const RUN: [Self; 9] = [
        Self::Evaluations,
        Self::Generations,
        Self::Predictions,
        Self::Skipped,
        Self::Workers,
        Self::Attempts,
        Self::Events,
        Self::Looks,
        Self::Run,
    ];
    /// The table that a search of several objectives adds to a run folder.
    pub const FRONT: [Self; 1] = [Self::Front];
    /// The table that a run on clouds of several sets adds to its folder.
    pub const SETS: [Self; 1] = [Self::Sets];
    /// The tables that a comparison adds to a run folder, in the order in which they are written.
    pub const COMPARISON: [Self; 5] =
        [Self::Distances, Self::Answers, Self::RecallPrecision, Self::Pairs, Self::Comparison];
    /// The tables of a run folder whose test clouds were perturbed in a comparison.
    pub const PERTURBED: [Self; 1] = [Self::Perturbed];
    /// The tables of a grid folder.
    pub const GRID: [Self; 6] =
        [Self::Cells, Self::Best, Self::Marginals, Self::Landscapes, Self::Counts, Self::Grid];
    /// The tables of artefacts, of which each has one.
    pub const ARTEFACT: [Self; 2] = [Self::Database, Self::Channels];

    /// Name of the file of a table that has one file.
    pub fn file(self) -> String {
        format!("{self}.parquet")
    }
}

impl fmt::Display for TableName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
