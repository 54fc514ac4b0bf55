//! What the operators of the settings make of parents.

use super::*;

/// Values of the parents and the children of each pair of siblings, where nothing mutates.
fn families_of(crossover: Crossover) -> Vec<[Vec<u32>; 4]> {
    let settings = GaSettings { elite: 2, mutation_rate: 0.0, crossover, ..by_slots_and_fields(12) };
    let strategy = GeneticAlgorithm::new(slotted(), settings, 8, decompose()).unwrap();
    let mut families = Vec::new();
    for pair in run_strategy(&strategy, 5, landscape(1)).windows(2) {
        let ((parents, _), (children, _)) = (&pair[0], &pair[1]);
        for siblings in children[2..].chunks(2) {
            let [Some(a), Some(b)] = siblings[0].parents else { panic!("no parents") };
            let parents = [a, b].map(|parent| &parents[parent as usize]);
            families.push([parents[0], parents[1], &siblings[0], &siblings[1]].map(|one| one.values.clone()));
        }
    }
    families
}

#[test]
fn without_mutation_siblings_share_out_their_parents_slots() {
    let (mut kept, mut swapped) = (0, 0);
    for [a, b, first, second] in &families_of(Crossover::Slots) {
        for slot in (0..12).step_by(3).map(|start| start..start + 3) {
            let [a, b, first, second] = [a, b, first, second].map(|values| &values[slot.clone()]);
            assert!([(a, b), (b, a)].contains(&(first, second)), "a slot in two");
            kept += u32::from((first, second) == (a, b) && a != b);
            swapped += u32::from((first, second) == (b, a) && a != b);
        }
    }
    assert!(kept > 20 && swapped > 20, "{kept} kept, {swapped} swapped");
}

#[test]
fn without_mutation_siblings_share_out_their_parents_slots_at_any_places() {
    let (mut elsewhere, mut both) = (0, 0);
    for [a, b, first, second] in &families_of(Crossover::AnySlots) {
        let slots_of = |values: [&Vec<u32>; 2]| {
            let mut slots: Vec<[u32; 3]> =
                values.into_iter().flat_map(|values| values.as_chunks().0.to_vec()).collect();
            slots.sort_unstable();
            slots
        };
        assert_eq!(slots_of([first, second]), slots_of([a, b]), "a slot in two, or lost");
        for place in 0..4 {
            let slot = |values: &[u32]| values.as_chunks::<3>().0[place];
            elsewhere += u32::from(![slot(a), slot(b)].contains(&slot(first)));
            // The slots of the first parent are at their own places, in either child.
            assert!([slot(first), slot(second)].contains(&slot(a)));
        }
        both += u32::from(
            slots_of([first, first]) != slots_of([a, a]) && slots_of([first, first]) != slots_of([b, b]),
        );
    }
    assert!(elsewhere > 20 && both > 5, "{elsewhere} slots elsewhere, {both} children of both parents");
}

#[test]
fn children_of_generation_g_change_each_field_that_may_change_with_p_of_g() {
    for (mutation, share) in [(Mutation::Field, 1.0), (Mutation::Slot, 0.25)] {
        let settings = GaSettings {
            elite: 1,
            crossover_rate: 0.0,
            mutation,
            mutation_rate: 0.4,
            mutation_decay: 0.5,
            ..by_slots_and_fields(1_000)
        };
        let strategy = GeneticAlgorithm::new(slotted(), settings, 2, decompose()).unwrap();
        // The first individual is the only parent.
        let log = run_strategy(&strategy, 4, |_, index, _| u32::from(index == 0));
        for (generation, rate) in [(1, 0.40), (2, 0.20), (3, 0.10)] {
            let parent = &log[generation - 1].0[0].values;
            let children = &log[generation].0[1..];
            let changes =
                |child: &Individual| child.values.iter().zip(parent).filter(|(a, b)| a != b).count();
            let changed: usize = children.iter().map(changes).sum();
            // Those of one slot in four may change, or all.
            let fields = (children.len() * parent.len()) as f64 * share;
            let deviation = (fields * rate * (1.0 - rate)).sqrt();
            assert!(
                (changed as f64 - fields * rate).abs() < 5.0 * deviation,
                "generation {generation}: {changed}"
            );
        }
    }
}

#[test]
fn children_of_generation_g_are_mutated_with_p_of_g() {
    // Crossing nothing over and drawing one parent only shows the flips themselves: of a pair of points on 25 bits
    // (2·(25 − d) ordered draws at distance d > 0, 25 at 0) the mean number of bits between, both included, is
    // 1 + (25² − 1) / (3·25) = 9.32, of which the share p flips.
    let settings = GaSettings {
        population: 2_000,
        elite: 1,
        crossover_rate: 0.0,
        mutation_decay: 0.5,
        ..GaSettings::default()
    };
    let log = run(settings, 2, 4, |_, index, _| u32::from(index == 0));
    for (generation, rate) in [(1, 0.40), (2, 0.20), (3, 0.10)] {
        let parent = &log[generation - 1].0[0].chromosome;
        let flips: usize = log[generation].0[1..]
            .iter()
            .map(|child| child.chromosome.iter().zip(parent).filter(|(a, b)| a != b).count())
            .sum();
        let mean = flips as f64 / 1_999.0;
        // The deviation of one child's flips is below 3.2, of the mean over 1999 below 0.072.
        assert!((mean - 9.32 * rate).abs() < 0.3, "generation {generation}: {mean}");
    }
}

#[test]
fn children_by_any_slots_follow_from_the_seed() {
    let settings =
        GaSettings { crossover: Crossover::AnySlots, mutation: Mutation::Slot, ..by_slots_and_fields(12) };
    for (method, preselection) in [(Method::Ga, 1), (Method::Ga, 4), (Method::Nsga2, 1)] {
        let settings = GaSettings { preselection, ..settings };
        let run = |seed| {
            let strategy = method.strategy(&slotted(), 1, settings, seed, decompose()).unwrap().unwrap();
            run_strategy(&*strategy, 6, landscape(2))
        };
        let log = run(7);
        assert_eq!(log, run(7), "{method:?}");
        assert!(log.iter().zip(&run(8)).all(|(a, b)| a.0 != b.0), "{method:?}");
        for individual in log.iter().flat_map(|(population, _)| population) {
            assert_eq!(individual.values, slotted().decode(&individual.chromosome));
        }
    }
}
