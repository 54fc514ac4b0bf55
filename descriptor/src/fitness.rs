//! Protocols of fitness: the nearest cloud of a query's own class and the nearest of the others, among the clouds that
//! it is compared with (DESIGN 5b).

use std::borrow::Borrow;

use rayon::prelude::*;

use crate::distance::{DistanceMatrix, set_distances};
use crate::recognise::{Hit, RecogniseError};

/// What a protocol of fitness knows of a cloud.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Member {
    /// What it is to be recognised as: its object, or its category.
    pub class: u32,
    /// Clouds of one group are not compared with each other, such as those of one sequence. `None`: it is compared with
    /// all.
    pub group: Option<u32>,
}

/// The nearest of the clouds that a query is compared with. Of equal distances the lowest index counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NearestOfClass {
    /// The nearest of the query's class.
    pub same: Option<Hit>,
    /// The nearest of all other classes.
    pub other: Option<Hit>,
}

/// The nearest clouds of every query, from the distances in each channel and its weight, by the current rayon pool.
///
/// # Errors
/// [`RecogniseError::EmptyDatabase`] if there are queries but no cloud to match with.
///
/// # Panics
/// If the matrices differ in size from queries or database: a programming error.
pub fn nearest_of_class<M: Borrow<DistanceMatrix> + Sync>(
    queries: &[Member],
    channels: &[(M, f64)],
    database: &[Member],
) -> Result<Vec<NearestOfClass>, RecogniseError> {
    for (matrix, _) in channels {
        assert_eq!(matrix.borrow().columns(), database.len(), "one member for each cloud of the database");
    }
    if database.is_empty() && !queries.is_empty() {
        return Err(RecogniseError::EmptyDatabase);
    }
    let found = |distances: &mut Vec<f64>, (query, member): (usize, &Member)| {
        set_distances(channels, query, distances);
        nearest(member, distances, database)
    };
    Ok(queries.par_iter().enumerate().map_init(Vec::new, found).collect())
}

/// The nearest clouds of one query, from its distances to the clouds of a database.
pub fn nearest(query: &Member, distances: &[f64], database: &[Member]) -> NearestOfClass {
    let mut found = NearestOfClass::default();
    for ((&distance, cloud), index) in distances.iter().zip(database).zip(0u32..) {
        if query.group.is_some() && cloud.group == query.group {
            continue;
        }
        let of_class = if cloud.class == query.class { &mut found.same } else { &mut found.other };
        if of_class.is_none_or(|best| distance.total_cmp(&best.distance).is_lt()) {
            *of_class = Some(Hit { index, distance });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::signature::{Signature, Signatures};

    fn members(most: usize) -> impl Strategy<Value = Vec<(u8, Member)>> {
        let member = (0u8..6, 0u32..4, prop::option::of(0u32..3))
            .prop_map(|(number, class, group)| (number, Member { class, group }));
        prop::collection::vec(member, 1..most)
    }

    /// Few numbers, so that many distances are equal.
    fn signatures(clouds: &[(u8, Member)]) -> Signatures {
        let signature = |(number, _): &(u8, Member)| {
            let share = f32::from(*number) / 8.0;
            Signature { centroid: vec![share, 1.0 - share], deviation: vec![0.0, 0.0] }
        };
        clouds.iter().map(signature).collect::<Vec<Signature>>().iter().collect()
    }

    proptest! {
        #[test]
        fn the_nearest_are_the_least_by_distance_and_index(
            queries in members(8),
            database in members(12),
            weight in 0.0f64..2.0,
        ) {
            let matrix = DistanceMatrix::new(&signatures(&queries), &signatures(&database));
            let channels = [(&matrix, weight), (&matrix, 0.3)];
            let [of_queries, of_database] =
                [&queries, &database].map(|side| side.iter().map(|(_, member)| *member).collect::<Vec<Member>>());
            let found = nearest_of_class(&of_queries, &channels, &of_database).unwrap();
            for (query, member) in of_queries.iter().enumerate() {
                let least = |is_of_class: bool| {
                    let compared = of_database.iter().enumerate().filter(|(_, cloud)| {
                        !(cloud.group.is_some() && cloud.group == member.group)
                            && (cloud.class == member.class) == is_of_class
                    });
                    let of_pair = |(index, _): (usize, &Member)| {
                        let distance = f64::from(matrix.row(query)[index]);
                        (weight * distance + 0.3 * distance, index)
                    };
                    compared.map(of_pair).min_by(|a, b| a.partial_cmp(b).unwrap())
                };
                let plain = |hit: Option<Hit>| hit.map(|hit| (hit.distance, hit.index as usize));
                prop_assert_eq!(plain(found[query].same), least(true));
                prop_assert_eq!(plain(found[query].other), least(false));
            }
        }
    }

    #[test]
    fn a_database_without_clouds_is_refused() {
        let none: [(DistanceMatrix, f64); 0] = [];
        let query = Member { class: 1, group: None };
        assert_eq!(nearest_of_class(&[query], &none, &[]), Err(RecogniseError::EmptyDatabase));
        assert_eq!(nearest_of_class(&[], &none, &[]), Ok(Vec::new()));
    }
}
