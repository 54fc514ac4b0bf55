//! How well an artefact answers: on labelled clouds, and on those of objects that it does not know.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use artefact::{Contents, Recogniser, channels, labels};
use descriptor::recogniser::{self, Evidence, HeldOut, LabelledClouds, MAX_CLOUDS, RejectError, RejectRule};
use descriptor::{Signature, Signatures};
use rayon::prelude::*;

use super::error::AssessError;
use super::held::HeldClouds;
use super::{describe_all, none_usable, reject};
use crate::dataset::{Layout, NamedCloud};
use crate::looks::Look;

/// Shares of false rejections, as they were calibrated, for which rejections are measured.
const RATES: [f64; 7] = [0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5];

/// What was measured.
#[derive(Clone, Debug)]
pub struct Assessment {
    /// Clouds that are test clouds of the run, if one was named.
    pub test_clouds: Option<usize>,
    /// Clouds whose object the artefact knows.
    pub known: usize,
    /// Those among them that are called by another object's name, whether or not the answer is believed.
    pub wrong: usize,
    /// Those that are called so by an answer that is believed.
    pub wrong_accepted: usize,
    /// Clouds of objects that the artefact does not know.
    pub foreign: usize,
    /// How many of these are rejected.
    pub foreign_rejected: usize,
    /// Clouds that are asked of the artefact without their object.
    pub left_out: usize,
    /// Clouds that were not asked, and why: they cannot be used, or the artefact holds them.
    pub skipped: Vec<(String, String)>,
    /// The artefact's share of false rejections, if it rejects.
    pub false_rejections: Option<f64>,
    /// What is rejected at several shares of false rejections, or why nothing can be.
    pub curve: Result<Vec<Rejected>, RejectError>,
    /// Of both rules: how often a known cloud's answer looks more like a known one's than the answer about a cloud
    /// without its object does; 1 is always, 0.5 by chance. `None` without clouds of either kind, or a rule.
    pub separation: Option<[f64; 2]>,
}

/// What rules that were calibrated for a share of false rejections reject: by probability, and by the margin alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rejected {
    /// The share, at most, of the artefact's reference clouds.
    pub false_rejections: f64,
    /// Of the clouds whose object is known: false rejections.
    pub known: [usize; 2],
    /// Of those that were asked without their object: right ones.
    pub left_out: [usize; 2],
}

/// A cloud that is asked.
struct Query {
    signatures: Vec<Signature>,
    instance: String,
    /// Whether the artefact has clouds of its object.
    is_known: bool,
}

/// Asks an artefact about the clouds of lists, by the current rayon pool: as it is, and without each object in turn, for
/// which its recogniser is learned again with the same settings. Rules keep what was found with all objects. A `look` is
/// noted before.
///
/// # Errors
/// [`AssessError`]: a cloud that cannot be used is only skipped.
pub fn assess(
    artefact: &Path,
    root: &Path,
    layout: &Layout,
    lists: &[PathBuf],
    look: Option<&Look>,
) -> Result<Assessment, AssessError> {
    let contents = Contents::read(artefact)?;
    let listed = NamedCloud::listed(root, layout, lists)?;
    let reference = contents.signatures(artefact)?;
    let scales = contents.settings.database.scales.clone();
    let clouds = contents.database.clouds.clone();
    let (descriptor, recognition, rule) =
        (contents.descriptor.clone(), contents.recognition, contents.reject);
    let false_rejections = contents.settings.reject.map(|reject| reject.false_rejections);
    let recogniser = contents.recogniser(artefact)?;
    let test_clouds = match look {
        Some(look) => {
            let files: Vec<&Path> = listed.iter().map(|cloud| cloud.file.as_path()).collect();
            Some(look.note(&files, descriptor.family().name())?)
        }
        None => None,
    };

    let (described, mut skipped) = describe_all(&recogniser, &listed);
    // A cloud that is held is at no distance from itself: that says nothing of clouds that are not.
    let held = HeldClouds::new(&clouds, &reference);
    let (described, of_artefact): (Vec<_>, Vec<_>) =
        described.into_iter().partition(|(_, signatures)| held.name(signatures).is_none());
    skipped.extend(of_artefact.iter().map(|(cloud, signatures)| {
        let name = held.name(signatures).unwrap_or_default();
        (cloud.path.clone(), format!("the artefact holds it as {name}"))
    }));
    let numbers: BTreeMap<&str, u32> = (clouds.iter().zip(labels(&clouds)))
        .map(|(cloud, label)| (&*cloud.instance, label.instance))
        .collect();
    let query = |(cloud, signatures): (&NamedCloud, Vec<Signature>)| Query {
        signatures,
        instance: cloud.instance.clone(),
        is_known: numbers.contains_key(&*cloud.instance),
    };
    let queries: Vec<Query> = described.into_iter().map(query).collect();
    if queries.is_empty() {
        return Err(AssessError::NoCloud { got: none_usable(&skipped) });
    }

    let (got, most) = (clouds.len() + queries.len(), 2 * MAX_CLOUDS);
    if got > most {
        return Err(AssessError::TooMany { got, most }); // of all pairs the distance is kept
    }
    let answers: Vec<Answered> = queries.par_iter().map(|query| answered(&recogniser, query)).collect();
    let (asked, foreign): (Vec<usize>, Vec<usize>) =
        (0..queries.len()).partition(|&query| queries[query].is_known);
    let count = |of: &[usize], is: &dyn Fn(&Answered) -> bool| {
        of.iter().filter(|&&query| is(&answers[query])).count()
    };
    let accepted = |answer: &Answered| match (rule, answer.evidence) {
        (Some(rule), Some(evidence)) => rule.accepts(evidence),
        _ => true,
    };

    let mut objects: Vec<u32> = clouds.iter().map(|cloud| numbers[&*cloud.instance]).collect();
    objects.extend(asked.iter().map(|&query| numbers[&*queries[query].instance]));
    let known: Vec<&Query> = asked.iter().map(|&query| &queries[query]).collect();
    let joined = joined(&reference, &known);
    let of_all = channels(&descriptor, scales.as_deref(), &joined);
    let labelled = LabelledClouds { channels: &of_all, objects: &objects };
    let left_out = without_their_object(recognition.as_ref(), &labelled, clouds.len());

    let known: Vec<Evidence> = asked.iter().filter_map(|&query| answers[query].evidence).collect();
    let (sequences, _) = reject::sequences(&clouds);
    let of_database = channels(&descriptor, scales.as_deref(), &reference);
    let cross = reject::answers(recognition.as_ref(), &of_database, &clouds, &sequences);
    let curve = cross.and_then(|cross| {
        RATES
            .iter()
            .map(|&rate| cross.calibrate(rate).map(|found| rejected(rate, &found.rule, &known, &left_out)))
            .collect()
    });
    Ok(Assessment {
        test_clouds,
        known: asked.len(),
        wrong: count(&asked, &|answer| !answer.is_right),
        wrong_accepted: count(&asked, &|answer| !answer.is_right && accepted(answer)),
        foreign: foreign.len(),
        foreign_rejected: count(&foreign, &|answer| !accepted(answer)),
        left_out: left_out.len(),
        skipped,
        false_rejections,
        curve,
        separation: rule.and_then(|rule| separation(&rule, &known, &left_out)),
    })
}

/// The signatures of the database, and after them those of the queries, of each channel: every pair is compared once.
fn joined(database: &[Signatures], queries: &[&Query]) -> Vec<Signatures> {
    let of_channel = |(channel, database): (usize, &Signatures)| {
        let database = (0..database.clouds()).map(|cloud| database.signature(cloud));
        let queries = queries.iter().map(|query| query.signatures[channel].clone());
        let all: Vec<Signature> = database.chain(queries).collect();
        all.iter().collect()
    };
    database.iter().enumerate().map(of_channel).collect()
}

/// What is answered to each query when the database lacks its object. The first `database` clouds are the database, the
/// others the queries.
fn without_their_object(
    recognition: Option<&recogniser::Settings>,
    clouds: &LabelledClouds<'_>,
    database: usize,
) -> Vec<Evidence> {
    let mut of_object: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (query, &object) in clouds.objects.iter().enumerate().skip(database) {
        of_object.entry(object).or_default().push(query);
    }
    let without = |(object, queries): (u32, Vec<usize>)| {
        ((0..database).filter(|&cloud| clouds.objects[cloud] != object).collect(), queries)
    };
    let rounds: Vec<(Vec<usize>, Vec<usize>)> = of_object.into_iter().map(without).collect();
    let answers = HeldOut::new(recognition, clouds).ask_all(&rounds).concat();
    answers.iter().map(|answer| answer.evidence).collect()
}

/// What an artefact says of a query.
struct Answered {
    is_right: bool,
    /// `None` where there is one object only.
    evidence: Option<Evidence>,
}

fn answered(recogniser: &Recogniser, query: &Query) -> Answered {
    let answer = recogniser.answer_to(&query.signatures, 2);
    Answered { is_right: answer.nearest().instance == query.instance, evidence: answer.evidence }
}

/// How many answers a rule rejects, and its bound on the margin alone.
fn rejected(rate: f64, rule: &RejectRule, known: &[Evidence], left_out: &[Evidence]) -> Rejected {
    let count = |answers: &[Evidence]| {
        [
            answers.iter().filter(|&&evidence| !rule.accepts(evidence)).count(),
            answers.iter().filter(|&&evidence| !rule.accepts_by_margin(evidence)).count(),
        ]
    };
    Rejected { false_rejections: rate, known: count(known), left_out: count(left_out) }
}

/// Of all pairs the share in which the known answer has the larger value, ties being half (the area under the curve of
/// rejections; Mann and Whitney's U): by probability, and by margin.
fn separation(rule: &RejectRule, known: &[Evidence], left_out: &[Evidence]) -> Option<[f64; 2]> {
    if known.is_empty() || left_out.is_empty() {
        return None;
    }
    let by = |value: &dyn Fn(Evidence) -> f64| {
        let values = |answers: &[Evidence]| -> Vec<f64> { answers.iter().map(|&one| value(one)).collect() };
        let (known, left_out) = (values(known), values(left_out));
        let halves =
            |a: &f64| -> u64 { left_out.iter().map(|b| if a > b { 2 } else { u64::from(a == b) }).sum() };
        let all: u64 = known.iter().map(halves).sum();
        all as f64 / (2 * known.len() * left_out.len()) as f64
    };
    Some([by(&|evidence| rule.probability(evidence)), by(&|evidence| evidence.margin)])
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: RejectRule = RejectRule {
        is_learned: true,
        typical_distance: 0.5,
        coefficients: [0.0, -1.0, 2.0, 0.0],
        least_probability: 0.5,
        least_margin: 0.2,
    };

    fn evidence(values: &[[f64; 2]]) -> Vec<Evidence> {
        values.iter().map(|&[distance, margin]| Evidence { distance, margin, nearest: 0.5 }).collect()
    }

    #[test]
    fn rejections_are_counted_by_either_rule() {
        // Twice the margin against the distance; the margin against 0.2.
        let known = evidence(&[[0.125, 0.25], [0.75, 0.25], [0.125, 0.125]]);
        let left_out = evidence(&[[0.875, 0.125], [0.875, 0.5]]);
        let expected = Rejected { false_rejections: 0.1, known: [1, 1], left_out: [1, 1] };
        assert_eq!(rejected(0.1, &RULE, &known, &left_out), expected);
        // By probability, 2 · margin − distance: 3/8, −1/4, 1/8 against −5/8, 1/8.
        let [by_probability, by_margin] = separation(&RULE, &known, &left_out).unwrap();
        assert_eq!(by_probability, (2.0 + 1.0 + 1.5) / 6.0);
        assert_eq!(by_margin, (1.0 + 1.0 + 0.5) / 6.0);
        assert_eq!(separation(&RULE, &known, &[]), None);
        assert_eq!(separation(&RULE, &[], &known), None);
    }
}
