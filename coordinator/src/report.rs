//! What a report says of a run beside its tables: channels of the winner, the verdict, and the clouds it gets wrong.

use std::path::Path;

use descriptor::Descriptor;
use descriptor::structure::{Pairs, Weighted};
use proto::Message;
use rayon::prelude::*;
use results::{
    ChannelPairs, FinishedRun, PredictionSplit, SeenCloud, ShownCloud, Told, WinnerChannel, WrongClouds,
};

use crate::compare::verdict_of_run;
use crate::examine::{DecimatedCloud, ExamineError, Examiner, Explanation};
use crate::experiment::{Experiment, Overrides};
use crate::looks;
use crate::reopen::winner_of;

/// Wrong answers that are shown in 3D.
const MOST_WRONG: usize = 30;
/// Points of a cloud that is shown.
const POINTS: usize = 1200;

/// What is known of the run in a folder. A run is shown as well whose experiment, comparison or clouds this program cannot
/// read: then there is less to say. That its test clouds are shown is noted in the folder, once.
pub fn told(folder: &Path) -> Told {
    let Ok(finished) = results::read_run(folder) else { return Told::default() };
    let verdict = verdict_of_run(folder, &finished.row).unwrap_or_default();
    let mut told = Told { verdict, ..Told::default() };
    let record = &finished.row.resolved_toml;
    let experiment = match Experiment::from_record(record, folder, None, Overrides::default()) {
        Ok(experiment) => experiment,
        Err(error) => {
            told.not_seen = Some(failed(&error));
            return told;
        }
    };
    let winner = match winner_of(experiment.space(), &finished.row) {
        Ok(winner) => winner,
        Err(error) => {
            told.not_seen = Some(failed(&error));
            return told;
        }
    };
    if let Descriptor::Structure(structure) = &winner {
        told.channels = structure.channels.iter().map(winner_channel).collect();
    }
    match seen_cloud(folder, &experiment, &winner) {
        Ok(seen) => told.seen = Some(seen),
        Err(reason) => told.not_seen = Some(reason),
    }
    match wrong_clouds(folder, &finished, &experiment, &winner) {
        Ok(wrong) => told.wrong = wrong,
        Err(reason) => told.no_clouds = Some(reason),
    }
    told
}

/// What went wrong, without what to do: a report is read by others.
fn failed(error: &dyn std::error::Error) -> String {
    Message::of(error).what
}

/// Where the winner looks on the first cloud that the run was trained on; `Err` says why there is none to see.
fn seen_cloud(folder: &Path, experiment: &Experiment, winner: &Descriptor) -> Result<SeenCloud, String> {
    let examiner = Examiner::new(folder, experiment).map_err(|error| failed(&error))?;
    let first = examiner.clouds().iter().find(|cloud| cloud.split == 0);
    let first = first.ok_or_else(|| "the run lists no training cloud".to_owned())?;
    examiner.reach(winner, &first.path).map_err(|error| failed(&error))
}

/// The wrong answers to test queries whose right cloud is furthest behind; `Err` says why there are none to see.
fn wrong_clouds(
    folder: &Path,
    finished: &FinishedRun,
    experiment: &Experiment,
    winner: &Descriptor,
) -> Result<Vec<WrongClouds>, String> {
    let answers = results::read_predictions(folder, PredictionSplit::Test).map_err(|error| failed(&error))?;
    let wrong: Vec<_> =
        answers.iter().filter(|answer| answer.instance != answer.predicted_instance).collect();
    if wrong.is_empty() {
        return Ok(Vec::new());
    }
    if finished.row.evaluation_version != descriptor::EVALUATION_VERSION {
        return Err("the run is of another release, which computes other distances".to_owned());
    }
    let examiner = Examiner::new(folder, experiment).map_err(|error| failed(&error))?;
    let explain =
        |answer: &&results::PredictionRow| examiner.explain(winner, &answer.cloud, &answer.nearest_cloud);
    let explained: Result<Vec<Explanation>, ExamineError> = wrong.par_iter().map(explain).collect();
    let mut explained = explained.map_err(|error| failed(&error))?;
    let margin = |one: &Explanation| one.margin.unwrap_or(f64::INFINITY);
    explained.sort_by(|a, b| margin(b).total_cmp(&margin(a)).then_with(|| a.query.cmp(&b.query)));
    explained.truncate(MOST_WRONG);
    note_look(folder, experiment).map_err(|error| failed(&error))?;
    let shown = |path: &str| -> Result<ShownCloud, ExamineError> {
        let DecimatedCloud { before, points, colours } = DecimatedCloud::new(&examiner.cloud(path)?, POINTS);
        let (name, object) = (path.to_owned(), examiner.record(path)?.instance.clone());
        Ok(ShownCloud { name, object, points, colours, total: u32::try_from(before).unwrap_or(u32::MAX) })
    };
    let triple = |one: Explanation| {
        Ok(WrongClouds {
            query: shown(&one.query)?,
            answer: shown(&one.answer)?,
            right: one.right.as_deref().map(shown).transpose()?,
            answer_distance: one.answer_distance,
            right_distance: one.right_distance,
            decided_by: (one.channels.len() > 1).then_some(one.decided_by),
        })
    };
    let triples: Result<Vec<WrongClouds>, ExamineError> = explained.into_par_iter().map(triple).collect();
    triples.map_err(|error| failed(&error))
}

/// Notes in a run folder that a report shows its test clouds, unless that is noted: a report that is made again shows
/// nothing more.
fn note_look(folder: &Path, experiment: &Experiment) -> Result<(), results::Error> {
    const COMMAND: &str = "report";
    if results::read_looks(folder)?.iter().any(|look| look.command == COMMAND) {
        return Ok(());
    }
    looks::note(folder, experiment, [COMMAND, "clouds that the winner gets wrong are shown", ""])
}

fn winner_channel(weighted: &Weighted) -> WinnerChannel {
    let Weighted { channel, .. } = weighted;
    let centimetres = |um: u32| f64::from(um) / 1e4;
    WinnerChannel {
        text: channel.to_string(),
        pairs: match channel.pairs {
            Pairs::KeypointNeighbour => ChannelPairs::KeypointNeighbour,
            Pairs::Neighbours => ChannelPairs::Neighbours,
            Pairs::Keypoints => ChannelPairs::Keypoints,
            Pairs::Cloud => ChannelPairs::Cloud,
        },
        features: channel.axes.iter().map(|axis| (axis.feature.name().to_owned(), axis.bins)).collect(),
        values: channel.bins(),
        weight: weighted.weight(),
        radius_cm: centimetres(channel.radius_um),
        shells_cm: channel.shells_um.iter().copied().map(centimetres).collect(),
        least_cm: centimetres(channel.least_um),
        grid_cm: centimetres(channel.grid_um),
    }
}
