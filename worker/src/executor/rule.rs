//! Matching rules on the clouds of split manifests.

use std::collections::BTreeMap;
use std::sync::Arc;

use descriptor::fitness::{Member, NearestOfClass};
use descriptor::recognise::Hit;
use proto::Digest;
use proto::task::{EvaluationResult, Exclusion, Label, MatchingRule, Nearest};

use crate::executor::error::EvaluationError;
use crate::executor::manifest::{Listed, Manifest};

/// The clouds of queries and of a database as a rule sees them.
///
/// # Errors
/// [`EvaluationError::Sequence`] if the rule is about sequences and a cloud has none.
pub(super) fn members(
    rule: &MatchingRule,
    sides: [&[Arc<Manifest>]; 2],
) -> Result<[Vec<Member>; 2], EvaluationError> {
    // Equal digests are one cloud, on either side.
    let mut numbers: BTreeMap<Digest, u32> = BTreeMap::new();
    let mut member = |manifest: &Manifest, cloud: &Listed| {
        let group = match rule.exclude {
            Exclusion::None => None,
            Exclusion::SameCloud => {
                let next = numbers.len() as u32;
                Some(*numbers.entry(cloud.digest).or_insert(next))
            }
            Exclusion::SameSequence => Some(cloud.sequence.ok_or_else(|| EvaluationError::Sequence {
                digest: manifest.digest,
                path: cloud.path.clone(),
            })?),
        };
        Ok::<_, EvaluationError>(Member { class: rule.class(label(cloud)), group })
    };
    let mut side = |manifests: &[Arc<Manifest>]| -> Result<Vec<Member>, EvaluationError> {
        let mut members = Vec::new();
        for manifest in manifests {
            for cloud in &manifest.clouds {
                members.push(member(manifest, cloud)?);
            }
        }
        Ok(members)
    };
    Ok([side(sides[0])?, side(sides[1])?])
}

/// The result of an evaluation whose queries have these nearest clouds.
pub(super) fn result(
    rule: &MatchingRule,
    sides: [&[Arc<Manifest>]; 2],
    found: &[NearestOfClass],
    want_matches: bool,
) -> EvaluationResult {
    let hit = |hit: Hit| (hit.index, hit.distance);
    let nearest: Vec<Nearest> = found
        .iter()
        .map(|found| Nearest { same: found.same.map(hit), other: found.other.map(hit) })
        .collect();
    let [queries, database] = sides.map(|manifests| -> Vec<Label> {
        manifests.iter().flat_map(|manifest| &manifest.clouds).map(label).collect()
    });
    let counts = rule.count(&nearest, &queries, &database);
    EvaluationResult { nearest: if want_matches { nearest } else { Vec::new() }, ..counts }
}

fn label(cloud: &Listed) -> Label {
    let descriptor::Label { category, instance } = cloud.label;
    Label { category, instance }
}
