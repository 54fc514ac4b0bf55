//! How a family is searched where the experiment file is silent: the defaults of [ga], [stop] and [search].

use crate::fitness::Fitness;
use descriptor::Family;
use evolution::{Crossover, GaSettings, Mutation, Scaling, StopSettings, WinnerRule};

/// The defaults of one family.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SearchDefaults {
    pub(super) ga: GaSettings,
    pub(super) stop: StopSettings,
    pub(super) fitness: Fitness,
    /// `None`: [`WinnerRule::paper`].
    winner: Option<WinnerRule>,
    /// Whether every key enters the texts that are hashed. Of families that were searched before there were
    /// search.winner and stop.evaluations, these enter only where they differ from their defaults: digests stay.
    pub(super) hashes_every_key: bool,
}

impl SearchDefaults {
    pub(super) fn of(family: Family) -> Self {
        match family {
            Family::DiskRing | Family::PfhRgb | Family::ShotColor | Family::GlobalHue => Self::paper(),
            Family::Structure => Self::structure(),
        }
    }

    /// The default of search.winner in a search that ends by this rule.
    pub(super) fn winner(&self, stop: &StopSettings) -> WinnerRule {
        self.winner.unwrap_or_else(|| WinnerRule::paper(stop))
    }

    fn paper() -> Self {
        Self {
            ga: GaSettings::default(),
            stop: StopSettings::default(),
            fitness: Fitness::PAPER,
            winner: None,
            hashes_every_key: false,
        }
    }

    /// For descriptors that are lists of channels, each of them a slot.
    fn structure() -> Self {
        Self {
            ga: GaSettings {
                population: 60,
                elite: 4,
                scaling: Scaling::Rank,
                crossover: Crossover::Slots,
                crossover_rate: 0.5,
                mutation: Mutation::Field,
                mutation_rate: 0.03,
                mutation_decay: 1.0,
                preselection: 1,
            },
            stop: StopSettings {
                validation_patience: None,
                stagnation: None,
                evaluations: Some(3000),
                ..StopSettings::default()
            },
            fitness: Fitness::CROSS_SEQUENCE,
            winner: Some(WinnerRule::Validation),
            hashes_every_key: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_of_families_of_plain_genes_are_the_papers() {
        for family in [Family::DiskRing, Family::GlobalHue] {
            let defaults = SearchDefaults::of(family);
            assert_eq!(
                (defaults.ga, defaults.stop, defaults.fitness),
                (GaSettings::default(), StopSettings::default(), Fitness::PAPER),
                "{family}"
            );
            let off = StopSettings { validation_patience: None, ..defaults.stop };
            let winners = [defaults.stop, off].map(|stop| defaults.winner(&stop));
            assert_eq!(winners, [WinnerRule::Validation, WinnerRule::Fitness]);
            assert!(!defaults.hashes_every_key);
        }
    }

    #[test]
    fn those_of_structures_are_valid_and_reach_their_budget() {
        let SearchDefaults { ga, stop, .. } = SearchDefaults::structure();
        assert_eq!((ga.validate(), stop.validate()), (Ok(ga), Ok(stop)));
        // Were every child new, half of the generations would do.
        let children = u64::from(ga.population - ga.elite) * u64::from(stop.generations);
        assert!(children >= 2 * u64::from(stop.evaluations.unwrap()), "{children}");
        // Whatever the stop rule.
        let patient = StopSettings { validation_patience: Some(1), ..stop };
        let winners = [stop, patient].map(|stop| SearchDefaults::structure().winner(&stop));
        assert_eq!(winners, [WinnerRule::Validation; 2]);
    }
}
