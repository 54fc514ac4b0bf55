//! The winner's ancestors.

use std::collections::{BTreeMap, BTreeSet};

use super::{error_axis, generations_axis, panel};
use crate::error::Error;
use crate::read::FinishedRun;
use crate::report::data::{Rows, percent};
use crate::report::figure::{Colour, Dash, Figure, Series, Symbol};

/// Generation and index of an individual.
type Id = (u32, u32);

/// The errors of the winner's ancestors among those of all individuals; `None` if it has none, as in a random search.
pub(crate) fn lineage(evaluations: &Rows, run: &FinishedRun) -> Result<Option<Figure>, Error> {
    let numbers = |column| evaluations.numbers(column);
    let (generation, individual) = (numbers("generation")?, numbers("individual")?);
    let errors = numbers("object_error")?;
    let parents = [evaluations.optional("parent_a")?, evaluations.optional("parent_b")?];
    let mut everybody: BTreeMap<Id, (f64, Vec<Id>)> = BTreeMap::new();
    for (row, &error) in errors.iter().enumerate() {
        let id = (generation[row] as u32, individual[row] as u32);
        let earlier = id.0.saturating_sub(1);
        let parents = parents.iter().filter_map(|parent| Some((earlier, parent[row]? as u32)));
        everybody.insert(id, (percent(error), parents.collect()));
    }
    let winner = (run.row.winner_generation, run.row.winner_individual);
    let ancestors = ancestors(&everybody, winner);
    if ancestors.len() < 2 {
        return Ok(None);
    }
    let place = |id: &Id| everybody.get(id).map(|(error, _)| [f64::from(id.0), *error]);
    let mut others: Vec<[f64; 2]> =
        everybody.keys().filter(|id| !ancestors.contains(id)).filter_map(place).collect();
    // Individuals of one generation often have the same error: a page need not draw a point on a point.
    others.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    others.dedup();
    let line = best_line(&everybody, winner).iter().filter_map(place).collect();
    let series = vec![
        Series::points("other individuals", Colour::Grey, Symbol::Dot, others),
        Series::points(
            "ancestors of the winner",
            Colour::Sky,
            Symbol::Circle,
            ancestors.iter().filter_map(place).collect(),
        ),
        Series::dashed("better parent of each", Colour::Blue, Dash::Solid, line),
        Series::points("winner", Colour::Black, Symbol::Triangle, place(&winner).into_iter().collect()),
    ];
    let caption = "Training errors of all individuals; those that the winner descends from are marked, and the line \
                   goes from the winner to its better parent, to the better parent of that one, and so on.";
    let panel = panel(generations_axis(), error_axis("training error"), series);
    Ok(Some(Figure::single("lineage", "Lineage of the winner", caption, panel)))
}

/// An individual, its parents, theirs and so on.
fn ancestors(everybody: &BTreeMap<Id, (f64, Vec<Id>)>, of: Id) -> BTreeSet<Id> {
    let (mut met, mut open) = (BTreeSet::from([of]), vec![of]);
    while let Some(id) = open.pop() {
        for &parent in everybody.get(&id).map_or(&[][..], |(_, parents)| parents) {
            if met.insert(parent) {
                open.push(parent);
            }
        }
    }
    met
}

/// From an individual to its better parent and on, the first on ties.
fn best_line(everybody: &BTreeMap<Id, (f64, Vec<Id>)>, of: Id) -> Vec<Id> {
    let mut line = vec![of];
    let mut at = of;
    // Parents are of the generation before: the walk ends.
    while let Some((_, parents)) = everybody.get(&at) {
        let error = |id: &Id| everybody.get(id).map_or(f64::INFINITY, |(error, _)| *error);
        let Some(&better) = parents.iter().min_by(|a, b| error(a).total_cmp(&error(b))) else { break };
        if better.0 >= at.0 {
            break;
        }
        line.push(better);
        at = better;
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ancestors_are_parents_of_parents_and_the_line_takes_the_better() {
        let people: BTreeMap<Id, (f64, Vec<Id>)> = BTreeMap::from([
            ((1, 0), (30.0, vec![])),
            ((1, 1), (20.0, vec![])),
            ((1, 2), (10.0, vec![])),
            ((2, 0), (15.0, vec![(1, 0), (1, 1)])),
            ((2, 1), (15.0, vec![(1, 1), (1, 1)])),
            ((3, 0), (12.0, vec![(2, 1), (2, 0)])),
        ]);
        let expected = BTreeSet::from([(3, 0), (2, 0), (2, 1), (1, 0), (1, 1)]);
        assert_eq!(ancestors(&people, (3, 0)), expected);
        assert_eq!(best_line(&people, (3, 0)), [(3, 0), (2, 1), (1, 1)]);
        assert_eq!(best_line(&people, (1, 2)), [(1, 2)]);
        // A file may name parents that are not there, or an individual as its own.
        let odd = BTreeMap::from([((0, 0), (1.0, vec![(0, 0)])), ((5, 0), (1.0, vec![(4, 7)]))]);
        assert_eq!(best_line(&odd, (0, 0)), [(0, 0)]);
        assert_eq!(ancestors(&odd, (5, 0)).len(), 2);
    }
}
