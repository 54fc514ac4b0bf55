//! The cheapest structure of a space: limits of cost below its cost leave nothing to search for.

use crate::cost;
use crate::structure::genes::FEATURES;
use crate::structure::{Structure, StructureSpace};

/// Fields of a slot that the cost of its only channel depends on, besides its features.
const PAIRS: usize = 1;
const RADIUS: usize = 9;
const GRID: usize = 12;
const SAMPLES: usize = 13;

impl StructureSpace {
    /// A structure of the space than which none is cheaper, to describe and to compare: one channel of one feature, the
    /// distance, which needs neither colours nor normals, in as few bins as there can be.
    pub fn cheapest(&self) -> Structure {
        let fields = self.fields();
        let values = |field: usize| 0..fields[field].values;
        let mut indices = vec![0; fields.len()];
        // The distance is the first feature; the other two are none.
        for field in PAIRS + 2..PAIRS + 1 + FEATURES {
            indices[field] = fields[field].values - 1;
        }
        let mut found = Vec::new();
        for pairs in values(PAIRS) {
            for radius in values(RADIUS) {
                for grid in values(GRID) {
                    for samples in values(SAMPLES) {
                        let choice = [(PAIRS, pairs), (RADIUS, radius), (GRID, grid), (SAMPLES, samples)];
                        choice.into_iter().for_each(|(field, index)| indices[field] = index);
                        found.extend(self.decode(&indices));
                    }
                }
            }
        }
        found.into_iter().min_by_key(cost::structure).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Descriptor;
    use crate::structure::genes::GENES;
    use crate::structure::testing::point;

    fn cost(structure: Structure) -> u64 {
        Descriptor::Structure(structure).recognition_cost()
    }

    #[test]
    fn fields_are_where_their_names_are() {
        let names = [(PAIRS, "s1_pairs"), (RADIUS, "s1_R"), (GRID, "s1_grid"), (SAMPLES, "s1_samples")];
        for (field, name) in names {
            assert_eq!(GENES[0][field].name, name);
        }
    }

    proptest! {
        #[test]
        fn no_structure_is_cheaper((space, indices) in point()) {
            let cheapest = space.cheapest();
            prop_assert!(space.encode(&cheapest).is_some());
            prop_assert!(cost(cheapest) <= cost(space.decode(&indices).unwrap()));
        }
    }
}
