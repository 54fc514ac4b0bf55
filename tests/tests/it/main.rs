//! One binary of end-to-end tests, so that the workspace is linked once.
//!
//! - `artefact`: what is taken away from a run
//! - `programs`: every command as a user runs it
//! - `bad_input`: what users get wrong, and what they are told
//! - `circles`: no file imports another in a circle
//! - `comparisons`: descriptors on the test clouds of a run
//! - `control`: orders to runs that go on
//! - `costs`: what a structure may cost, and what counts as recognised
//! - `descriptions`: channels that one worker describes for all
//! - `determinism`: one digest, whatever the workers do
//! - `families`: another family than the paper's
//! - `documents`: commands, links and generated pages of the documents
//! - `remembering`: caches and what is kept from run to run
//! - `resuming`: coordinators that are killed and started again
//! - `several_objectives`: fronts of NSGA-II, and what is made of their points
//! - `several_sets`: clouds of several sets, each compared within itself
//! - `sessions`: bring-up, waiting and deadline of every command
//! - `exhaust`: the exhaustive search, and what runs make of it
//! - `fitness`: clouds that a protocol of fitness cannot match
//! - `foreign`: descriptors that another program has computed
//! - `foreign_folders`: folders of somebody else, and runs without a journal
//! - `formats`: clouds in files of other formats than PCD
//! - `grid`: grid cells against the evaluator on real clouds
//! - `hill_climbing`: hill climbing end to end
//! - `hosts`: workers on other hosts, behind links that are cut, slow, lossy or late
//! - `perturbed`: errors on test clouds that are perturbed
//! - `peer`: a worker by hand, for tests of attacks
//! - `pieces`: evaluations in pieces
//! - `packages`: what packages contain beside the programs
//! - `protocol`: the coordinator's port as a client sees it
//! - `looks`: measurements on test clouds, noted in their run
//! - `lost_output`: standard output and error that are full or closed
//! - `leaks`: what positions of clouds give away
//! - `metrics`: what Prometheus and probes are told
//! - `messages`: what a user who begins is told
//! - `operators`: settings of a search beyond the paper's
//! - `hostile`: workers that attack a run
//! - `impostors`: peers that are not what they seem
//! - `query`: SQL over what runs have written
//! - `sweeps`: several runs over one set of workers
//! - `structures`: descriptors that are lists of channels, under every protocol of fitness
//! - `members`: structures that are shipped as files
//! - `unknown_objects`: what an artefact rejects and what it learns
//! - `upgrades`: what earlier releases have left
//! - `verdicts`: the end of runs and sweeps, beside baselines
//! - `strangers`: who is let in, who is not, and what those can do who are not
//! - `report`: the report of runs, in a browser
//! - `parity`: agreement with PCL on its reference values
//! - `repository`: the rules of this repository

#![expect(
    clippy::unwrap_used,
    reason = "a test that cannot go on has failed; helpers of tests are no tests to clippy"
)]

mod artefact;
mod bad_input;
mod circles;
mod comparisons;
mod control;
mod costs;
mod dashboard;
mod descriptions;
mod determinism;
mod documents;
mod exhaust;
mod families;
mod fitness;
mod foreign;
mod foreign_folders;
mod formats;
mod grid;
mod hill_climbing;
mod hostile;
mod hosts;
mod impostors;
mod joining;
mod leaks;
mod lifetimes;
mod looks;
mod lost_output;
mod members;
mod messages;
mod metrics;
mod operators;
mod packages;
mod parity;
mod peer;
mod perturbed;
mod pieces;
mod poison;
mod programs;
mod protocol;
mod query;
mod recognisers;
mod remembering;
mod report;
mod repository;
mod resuming;
mod sessions;
mod several_objectives;
mod several_sets;
mod signatures;
mod strangers;
mod structures;
mod sweeps;
mod units;
mod unknown_objects;
mod upgrades;
mod verdicts;
mod weighing;

use tests::{browser, experiments, http, process};
