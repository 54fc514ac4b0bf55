//! Members of structures in experiments.

use descriptor::{Descriptor, SearchSpace, structure::StructureSpace};

use super::parse;

pub(super) const SAMPLE: &str = include_str!("../../../testdata/experiment-v1-members.toml");

#[test]
fn members_are_written_out_with_their_slots_and_one_is_not() {
    let sample = parse(SAMPLE).unwrap();
    let space = StructureSpace { slots: 6, members: 3, ..StructureSpace::default() };
    assert_eq!(sample.space(), &SearchSpace::Structures(space));
    let toml = sample.search_toml();
    assert!(toml.contains("\nslots = 6\nmembers = 3\nmax_bins = 500\n"), "{toml}");
    assert_eq!(parse(&sample.resolved_toml()), Ok(sample));

    let [one, none] =
        ["members = 1\n", ""].map(|members| parse(&SAMPLE.replace("members = 3\n", members)).unwrap());
    assert_eq!(one, none);
    assert!(one.search_toml().contains("\nslots = 4\nmax_bins = 500\n"), "{}", one.search_toml());
}

#[test]
fn operators_on_slots_read_back_as_what_was_written() {
    for mutation in ["in-order", "field", "slot"] {
        for crossover in ["uniform", "slots", "any-slots"] {
            let operators =
                format!("crossover = \"{crossover}\"\ncrossover_rate = 0.5\nmutation = \"{mutation}\"\n");
            let experiment = parse(&format!("{SAMPLE}[ga]\n{operators}")).unwrap();
            let text = experiment.search_toml();
            assert!(text.contains(&operators), "{text}");
            assert_eq!(parse(&experiment.resolved_toml()), Ok(experiment));
        }
    }
}

#[test]
fn a_member_may_cost_its_share() {
    let Descriptor::Structure(structure) = Descriptor::default_of(descriptor::Family::Structure) else {
        panic!("a structure")
    };
    let of_channels = |count: usize| {
        let mut structure = structure.clone();
        structure.channels = structure.channels.iter().cycle().take(count).cloned().collect();
        Descriptor::Structure(structure)
    };
    for channels in 1..=3 {
        let descriptor = of_channels(channels);
        let cost = descriptor.recognition_cost();
        let least = if channels < 3 { 3 * cost } else { cost };
        for (max_cost, is_afforded) in [(least, true), (least - 1, false)] {
            let text = SAMPLE.replace("900_000", &max_cost.to_string());
            assert_eq!(parse(&text).unwrap().affords(&descriptor), is_afforded, "{channels}: {max_cost}");
        }
    }
}
