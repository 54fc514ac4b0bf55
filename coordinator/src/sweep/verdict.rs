//! What the seeds of a sweep say together: how good its winners are, how far seeds differ, and in how many of them the
//! winner is better than descriptors that anybody has.

use descriptor::recogniser::Method;
use results::{ComparedRow, Counts, PairRow, RunRow};

use crate::compare::{Difference, Level, differences};
use crate::lines::percent;

/// A finished member of a sweep, as far as a verdict needs it.
pub struct Seed<'a> {
    /// The variant that it is of; empty if there is none.
    pub variant: &'a str,
    /// What its fitness counts.
    level: Level,
    /// Its winner on the test clouds, if there are any.
    pub test: Option<Counts>,
    /// Its winner beside others.
    pub compared: &'a [ComparedRow],
    /// Every pair of these.
    pub pairs: &'a [PairRow],
}

impl<'a> Seed<'a> {
    /// The member of this name.
    pub fn new(member: &'a str, run: &RunRow, compared: &'a [ComparedRow], pairs: &'a [PairRow]) -> Self {
        Self { variant: variant(member, run.seed), level: Level::of(run), test: run.test, compared, pairs }
    }
}

/// Of each variant its name, empty where there is none, and what its seeds say, in sentences. Nothing of those with one
/// seed: its own summary says it.
pub fn verdicts(seeds: &[Seed<'_>]) -> Vec<(String, Vec<String>)> {
    let mut variants: Vec<(&str, Vec<&Seed<'_>>)> = Vec::new();
    for seed in seeds {
        match variants.iter_mut().find(|(known, _)| *known == seed.variant) {
            Some((_, seeds)) => seeds.push(seed),
            None => variants.push((seed.variant, vec![seed])),
        }
    }
    variants.retain(|(_, seeds)| seeds.len() > 1);
    variants.into_iter().map(|(variant, seeds)| (variant.to_owned(), sentences(&seeds))).collect()
}

/// The variant that a member of a sweep is of; empty if there is none.
pub fn variant(member: &str, seed: u64) -> &str {
    let of_seed = member.strip_suffix(&format!("seed-{seed}"));
    of_seed.map_or(member, |variant| variant.strip_suffix('-').unwrap_or(variant))
}

fn sentences(seeds: &[&Seed<'_>]) -> Vec<String> {
    let errors: Option<Vec<f64>> =
        seeds.iter().map(|seed| Some(seed.level.errors(seed.test?).share())).collect();
    let Some(mut errors) = errors else { return Vec::new() }; // no test clouds
    errors.sort_by(f64::total_cmp);
    let [least, most] = [errors[0], errors[errors.len() - 1]];
    let level = seeds[0].level; // variants differ in what they count, seeds do not
    let mut sentences = vec![format!(
        "{} of test clouds {}, median of {} seeds; {} to {}",
        percent(median(&errors)),
        level.wrong(),
        errors.len(),
        percent(least),
        percent(most)
    )];
    let mut others: Vec<(&ComparedRow, Vec<Difference<'_>>)> = Vec::new();
    for seed in seeds {
        for one in differences(seed.compared, seed.pairs, (seed.level, Method::Nearest)) {
            match others.iter_mut().find(|(other, _)| other.descriptor == one.other.descriptor) {
                Some((_, found)) => found.push(one),
                None => others.push((one.other, vec![one])),
            }
        }
    }
    // Winners of other runs, with which single seeds were compared, are not the same for all.
    others.retain(|(_, found)| found.len() == seeds.len());
    for (other, found) in others {
        let better = found.iter().filter(|one| one.points > 0.0).count();
        let sure = found.iter().filter(|one| one.points > 0.0 && one.is_sure()).count();
        let worse = found.iter().filter(|one| one.points < 0.0 && one.is_sure()).count();
        let worse = if worse == 0 { String::new() } else { format!(", worse with evidence in {worse}") };
        sentences.push(format!(
            "better than {} ({}) in {better} of {} seeds, with evidence in {sure}{worse}",
            other.descriptor,
            percent(level.errors(other.counts).share()),
            found.len()
        ));
    }
    sentences
}

/// Of values in ascending order; of an even number the mean of the two in the middle.
fn median(values: &[f64]) -> f64 {
    let middle = values.len() / 2;
    if values.len() % 2 == 1 { values[middle] } else { (values[middle - 1] + values[middle]) / 2.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_the_middle() {
        assert_eq!([median(&[3.0]), median(&[1.0, 2.0]), median(&[1.0, 2.0, 9.0])], [3.0, 1.5, 2.0]);
    }

    #[test]
    fn members_are_of_the_variant_before_their_seed() {
        assert_eq!(variant("seed-12", 12), "");
        assert_eq!(variant("pop-10-seed-2", 2), "pop-10");
        assert_eq!(variant("pop-10", 2), "pop-10");
        assert_eq!(variant("seed-1-seed-1", 1), "seed-1");
    }
}
