//! Settings of the genetic algorithm and of its stop rule, with the paper's values as defaults.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The largest population: with counts below 2³² every sum of selection weights then fits 64 bits.
pub const MAX_POPULATION: u32 = 65_536;

/// The most children to choose each from.
pub const MAX_PRESELECTION: u32 = 64;

/// The most children that a generation is chosen from: to choose takes some seconds then.
pub const MAX_BRED: u32 = 16_384;

/// How correct counts become selection weights (DESIGN 5.9).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Scaling {
    /// The counts themselves (paper).
    #[default]
    None,
    /// Goldberg's linear scaling: the mean stays, the best expects twice the mean.
    Linear,
    /// The rank, from 1 for the worst; equal counts share their mean rank.
    Rank,
}

/// How two parents make two children.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", rename = "crossover")]
pub enum Crossover {
    /// Each bit is exchanged with the same probability (paper).
    #[default]
    Uniform,
    /// Each slot is exchanged as a whole with the same probability. Where the family has no slots, each gene is one.
    Slots,
    /// As "slots", but between slots at any places, so that a child may have the same slot twice. The family must have slots.
    AnySlots,
}

/// How children are changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", rename = "mutation")]
pub enum Mutation {
    /// Bits between two random points flip with some probability (paper).
    #[default]
    InOrder,
    /// Each gene gets another value with some probability: in half of the cases one step up or down, else any other;
    /// always any other where the values are in no order.
    Field,
    /// As "field", but only genes of one slot change, each slot as likely. Where the family has no slots, each gene is one.
    Slot,
}

/// How generations are made (DESIGN 5.8, 5.9 and 5b).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaSettings {
    /// Individuals a generation, 2 to [`MAX_POPULATION`]. Default 10 (paper).
    pub population: u32,
    /// Best individuals copied unmutated, fewer than `population`. Default 1 (paper).
    pub elite: u32,
    /// Scaling of fitness before the roulette. Default none (paper).
    pub scaling: Scaling,
    /// How two parents make two children. Default uniform (paper).
    pub crossover: Crossover,
    /// Probability that crossover swaps a bit or slot, 0 to 1. Default 0.5 (paper).
    pub crossover_rate: f64,
    /// How children are changed. Default in order (paper).
    pub mutation: Mutation,
    /// Probability p(1) that mutation flips a bit between its points, or changes a field
    /// (with [`Mutation::Slot`], of the drawn slot), 0 to 1. Default 0.40 (paper).
    pub mutation_rate: f64,
    /// Factor r of p(g + 1) = p(g)·r, 0 to 1. Default 0.97 (the paper lowers the rate but gives no factor).
    pub mutation_decay: f64,
    /// Children that are made for each that is evaluated, 1 to [`MAX_PRESELECTION`]: a model of the fitness chooses.
    /// Default 1 (paper).
    pub preselection: u32,
}

impl Default for GaSettings {
    fn default() -> Self {
        Self {
            population: 10,
            elite: 1,
            scaling: Scaling::None,
            crossover: Crossover::Uniform,
            crossover_rate: 0.5,
            mutation: Mutation::InOrder,
            mutation_rate: 0.40,
            mutation_decay: 0.97,
            preselection: 1,
        }
    }
}

impl GaSettings {
    /// The settings themselves if they make an algorithm, else the first of them that does not.
    pub fn validate(self) -> Result<Self, SettingsError> {
        if !(2..=MAX_POPULATION).contains(&self.population) {
            return Err(SettingsError::Population { got: self.population });
        }
        if self.elite >= self.population {
            return Err(SettingsError::Elite { got: self.elite, population: self.population });
        }
        for (key, got) in [
            ("ga.crossover_rate", self.crossover_rate),
            ("ga.mutation_rate", self.mutation_rate),
            ("ga.mutation_decay", self.mutation_decay),
        ] {
            // The range holds neither NaN nor an infinity.
            if !(0.0..=1.0).contains(&got) {
                return Err(SettingsError::Rate { key, got });
            }
        }
        if !(1..=MAX_PRESELECTION).contains(&self.preselection) {
            return Err(SettingsError::Preselection { got: self.preselection });
        }
        let bred = u64::from(self.preselection) * u64::from(self.population);
        if self.preselection > 1 && bred > u64::from(MAX_BRED) {
            return Err(SettingsError::Bred { preselection: self.preselection, population: self.population });
        }
        Ok(self)
    }

    /// p(g) = `mutation_rate`·`mutation_decay`^(g − 1), generations counted from 1 (DESIGN 5.9).
    ///
    /// It is the rate of the generation that is left: the children of generation g are mutated with p(g), so the
    /// first mutation, which leads from the random generation 1 to generation 2, uses `mutation_rate` itself.
    pub fn mutation_rate(&self, generation: u32) -> f64 {
        // One multiplication after the other: a power function may round differently on another platform.
        (1..generation).fold(self.mutation_rate, |rate, _| rate * self.mutation_decay)
    }
}

/// When a run ends (DESIGN 5.10).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopSettings {
    /// Stop when the best individual names every training query correctly. Default true (paper).
    pub perfect: bool,
    /// Stop when validation errors have risen this many generations in a row, at least 1; `None`: never for this
    /// reason. Default 1 (paper).
    pub validation_patience: Option<u32>,
    /// Stop after this many generations without a strictly better training fitness, at least 1; `None`: never for
    /// this reason. Default 40 (paper).
    pub stagnation: Option<u32>,
    /// Stop after this many generations, at least 1. Default 200 (paper).
    pub generations: u32,
    /// Stop when this many different individuals have been evaluated, at least 1; `None`: never for this reason. Default
    /// none (paper).
    pub evaluations: Option<u32>,
}

impl Default for StopSettings {
    fn default() -> Self {
        Self {
            perfect: true,
            validation_patience: Some(1),
            stagnation: Some(40),
            generations: 200,
            evaluations: None,
        }
    }
}

impl StopSettings {
    /// The settings themselves if they make a stop rule, else the first of them that does not.
    pub fn validate(self) -> Result<Self, SettingsError> {
        for (key, got) in [
            ("stop.validation_patience", self.validation_patience),
            ("stop.stagnation", self.stagnation),
            ("stop.generations", Some(self.generations)),
        ] {
            if got == Some(0) {
                return Err(SettingsError::Generations { key });
            }
        }
        if self.evaluations == Some(0) {
            return Err(SettingsError::Evaluations);
        }
        Ok(self)
    }
}

/// Why settings make no genetic algorithm or no stop rule.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// Too few individuals to choose between, or more than the sums allow.
    #[error(
        "ga.population: not between 2 and 65536, got {got}\nset it to the individuals a generation, such as 10"
    )]
    Population { got: u32 },
    /// No room left for children.
    #[error(
        "ga.elite: not below ga.population = {population}, got {got}\nset it to the individuals copied unchanged, such as 1"
    )]
    Elite { got: u32, population: u32 },
    /// A probability or factor outside its range.
    #[error("{key}: not between 0 and 1, got {got}\nset it to a probability or factor in this range")]
    Rate { key: &'static str, got: f64 },
    /// Nothing to choose from, or more than is worth it.
    #[error(
        "ga.preselection: not between 1 and 64, got {got}\nset it to the children to choose each from, such as 8, or 1 to evaluate all"
    )]
    Preselection { got: u32 },
    /// More children to choose from than is worth it.
    #[error(
        "ga.preselection: not at most 16384 children a generation, got {preselection} times ga.population = {population}\nlower one of them"
    )]
    Bred { preselection: u32, population: u32 },
    /// A number of generations that could never pass.
    #[error("{key}: not at least 1, got 0\nset it to a number of generations from 1")]
    Generations { key: &'static str },
    /// A budget that is spent before the first generation.
    #[error("stop.evaluations: not at least 1, got 0\nset it to a number of evaluations from 1")]
    Evaluations,
}

#[cfg(test)]
mod tests {
    use expect_test::expect;

    use super::*;

    const GA: fn() -> GaSettings = GaSettings::default;
    const STOP: fn() -> StopSettings = StopSettings::default;

    #[test]
    fn defaults_are_the_papers_and_valid() {
        let ga = GA().validate().unwrap();
        assert_eq!((ga.population, ga.elite, ga.scaling), (10, 1, Scaling::None));
        assert_eq!((ga.crossover, ga.mutation), (Crossover::Uniform, Mutation::InOrder));
        assert_eq!((ga.crossover_rate, ga.mutation_rate, ga.mutation_decay), (0.5, 0.40, 0.97));
        assert_eq!(ga.preselection, 1);
        let stop = STOP().validate().unwrap();
        assert_eq!(
            (stop.perfect, stop.validation_patience, stop.stagnation, stop.generations),
            (true, Some(1), Some(40), 200)
        );
        assert_eq!(stop.evaluations, None);
    }

    #[test]
    fn the_extremes_of_every_setting_are_valid() {
        for population in [2, MAX_POPULATION] {
            for elite in [0, population - 1] {
                for rate in [0.0, 1.0] {
                    let (crossover_rate, mutation_rate, mutation_decay) = (rate, rate, rate);
                    let ga = GaSettings {
                        population,
                        elite,
                        crossover_rate,
                        mutation_rate,
                        mutation_decay,
                        preselection: if population == 2 { MAX_PRESELECTION } else { 1 },
                        ..GA()
                    };
                    assert_eq!(ga.validate(), Ok(ga));
                }
            }
        }
        for evaluations in [None, Some(1), Some(u32::MAX)] {
            let stop = StopSettings {
                perfect: false,
                validation_patience: None,
                stagnation: None,
                generations: 1,
                evaluations,
            };
            assert_eq!(stop.validate(), Ok(stop));
        }
    }

    #[test]
    fn what_lies_outside_is_refused_by_name() {
        for population in [0, 1, MAX_POPULATION + 1] {
            let error = GaSettings { population, elite: 0, ..GA() }.validate().unwrap_err();
            assert_eq!(error, SettingsError::Population { got: population });
        }
        for elite in [10, 11] {
            let error = GaSettings { elite, ..GA() }.validate().unwrap_err();
            assert_eq!(error, SettingsError::Elite { got: elite, population: 10 });
        }
        let bred = |population| GaSettings { preselection: 8, population, ..GA() }.validate();
        assert!(bred(2048).is_ok());
        assert_eq!(bred(2049), Err(SettingsError::Bred { preselection: 8, population: 2049 }));
        for got in [0, 65] {
            let error = GaSettings { preselection: got, ..GA() }.validate().unwrap_err();
            assert_eq!(error, SettingsError::Preselection { got });
        }
        for got in [-0.1, 1.000_001, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for (key, ga) in [
                ("ga.crossover_rate", GaSettings { crossover_rate: got, ..GA() }),
                ("ga.mutation_rate", GaSettings { mutation_rate: got, ..GA() }),
                ("ga.mutation_decay", GaSettings { mutation_decay: got, ..GA() }),
            ] {
                let error = ga.validate().unwrap_err();
                assert!(matches!(error, SettingsError::Rate { key: k, .. } if k == key), "{error}");
            }
        }
        for (key, stop) in [
            ("stop.validation_patience", StopSettings { validation_patience: Some(0), ..STOP() }),
            ("stop.stagnation", StopSettings { stagnation: Some(0), ..STOP() }),
            ("stop.generations", StopSettings { generations: 0, ..STOP() }),
        ] {
            assert_eq!(stop.validate(), Err(SettingsError::Generations { key }));
        }
        let stop = StopSettings { evaluations: Some(0), ..STOP() };
        assert_eq!(stop.validate(), Err(SettingsError::Evaluations));
    }

    #[test]
    fn messages_name_place_value_and_remedy() {
        let errors = [
            SettingsError::Population { got: 1 },
            SettingsError::Elite { got: 10, population: 10 },
            SettingsError::Rate { key: "ga.mutation_rate", got: 1.5 },
            SettingsError::Preselection { got: 65 },
            SettingsError::Bred { preselection: 8, population: 2049 },
            SettingsError::Generations { key: "stop.stagnation" },
            SettingsError::Evaluations,
        ];
        expect![[r#"
            ga.population: not between 2 and 65536, got 1
            set it to the individuals a generation, such as 10
            ga.elite: not below ga.population = 10, got 10
            set it to the individuals copied unchanged, such as 1
            ga.mutation_rate: not between 0 and 1, got 1.5
            set it to a probability or factor in this range
            ga.preselection: not between 1 and 64, got 65
            set it to the children to choose each from, such as 8, or 1 to evaluate all
            ga.preselection: not at most 16384 children a generation, got 8 times ga.population = 2049
            lower one of them
            stop.stagnation: not at least 1, got 0
            set it to a number of generations from 1
            stop.evaluations: not at least 1, got 0
            set it to a number of evaluations from 1"#]]
        .assert_eq(&errors.map(|error| error.to_string()).join("\n"));
    }

    #[test]
    fn the_mutation_rate_falls_by_repeated_multiplication() {
        let ga = GA();
        assert_eq!(ga.mutation_rate(1), 0.40);
        assert_eq!(ga.mutation_rate(2), 0.40 * 0.97);
        let mut product = 0.40;
        for generation in 1..=200 {
            assert_eq!(ga.mutation_rate(generation).to_bits(), f64::to_bits(product));
            product *= 0.97;
        }
        // 0.40·0.97^199, from 40-digit decimal arithmetic.
        assert!((ga.mutation_rate(200) / 9.324_705_195_858_878e-4 - 1.0).abs() < 1e-13);
        assert_eq!(GaSettings { mutation_decay: 1.0, ..ga }.mutation_rate(200), 0.40);
        assert_eq!(GaSettings { mutation_decay: 0.0, ..ga }.mutation_rate(2), 0.0);
    }
}
