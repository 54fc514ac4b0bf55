//! What the search has learned about each gene: where the population went, and the errors it met there.

use std::collections::BTreeMap;

use super::{error_axis, generations_axis, quantile, zip};
use crate::columns::GeneColumn;
use crate::error::Error;
use crate::report::data::{Rows, percent};
use crate::report::figure::{Axis, Colour, Dash, Figure, Numbers, Panel, Series, Symbol};

const HEIGHT: u32 = 230;

/// The best individual's genes and the population's spread, one panel per gene that varies.
pub(crate) fn trajectories(evaluations: &Rows, generations: &Rows) -> Result<Figure, Error> {
    let generation = evaluations.numbers("generation")?;
    let individual = evaluations.numbers("individual")?;
    let best: BTreeMap<u64, u64> = generations
        .numbers("generation")?
        .into_iter()
        .zip(generations.numbers("best_individual")?)
        .map(|(generation, best)| (generation as u64, best as u64))
        .collect();
    let mut panels = Vec::new();
    for gene in evaluations.genes() {
        let values = evaluations.optional(&gene.name)?;
        let mut population: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
        let mut line = Vec::new();
        for ((&generation, &individual), value) in generation.iter().zip(&individual).zip(values) {
            let Some(value) = value else { continue };
            population.entry(generation as u64).or_default().push(value);
            if best.get(&(generation as u64)) == Some(&(individual as u64)) {
                line.push([generation, value]);
            }
        }
        if !vary(population.values().flatten()) {
            continue;
        }
        let band = |low: f64, high: f64| {
            let of = |(&generation, values): (&u64, &Vec<f64>)| {
                let mut sorted = values.clone();
                sorted.sort_by(f64::total_cmp);
                Some([generation as f64, quantile(&sorted, low)?, quantile(&sorted, high)?])
            };
            population.iter().filter_map(of).collect::<Vec<_>>()
        };
        let series = vec![
            Series::band("population: lowest to highest", Colour::Sky, band(0.0, 1.0)),
            Series::band("population: middle half", Colour::Blue, band(0.25, 0.75)),
            Series::steps("best individual", Colour::Black, Dash::Solid, line),
        ];
        let (x, y) = (generations_axis(), gene_axis(&gene));
        panels.push(Panel { title: String::new(), x, y, series, height: HEIGHT });
    }
    Ok(Figure {
        id: "genes".to_owned(),
        title: "Parameter trajectories".to_owned(),
        caption: "Each gene from generation to generation: the generation's best individual, and how the population \
                  spreads around it."
            .to_owned(),
        panels,
        columns: 2,
        numbers: Numbers::Below,
    })
}

/// The error over the values of each gene that varies, over all values of the others.
///
/// `grid` is table `marginals` of an exhaustive search.
pub(crate) fn marginals(evaluations: &Rows, grid: Option<&Rows>) -> Result<Figure, Error> {
    let errors = evaluations.numbers(&format!("{}_error", evaluations.counted()?))?;
    let mut panels = Vec::new();
    for gene in evaluations.genes() {
        let values = evaluations.optional(&gene.name)?;
        // By bits: values of a gene are on a grid, equal ones are equal bit for bit, and none is negative.
        let mut met: BTreeMap<u64, Met> = BTreeMap::new();
        for (value, &error) in values.into_iter().zip(&errors) {
            if let Some(value) = value {
                met.entry(value.to_bits()).or_default().add(percent(error));
            }
        }
        if met.len() < 2 {
            continue;
        }
        let points = |of: fn(&Met) -> f64| {
            met.iter().map(|(&bits, met)| [f64::from_bits(bits), of(met)]).collect::<Vec<_>>()
        };
        let mut series = vec![
            Series::points("evaluated: mean", Colour::Blue, Symbol::Circle, points(Met::mean)),
            Series::points(
                "evaluated: lowest",
                Colour::Vermillion,
                Symbol::Triangle,
                points(|met| met.lowest),
            ),
        ];
        if let Some(grid) = grid {
            series.extend(exact(grid, &gene.name)?);
        }
        let (x, y) = (gene_axis(&gene), error_axis("training error"));
        panels.push(Panel { title: String::new(), x, y, series, height: HEIGHT });
    }
    let mut caption = String::from(
        "Training error of all individuals that had a value of a gene, whatever their other genes were. The search \
         looks at good regions more often: a mean says as much about the search as about the gene.",
    );
    if grid.is_some() {
        caption
            .push_str(" The lines are exact: the mean and the best of all descriptors of the search space.");
    }
    Ok(Figure {
        id: "marginals".to_owned(),
        title: "Marginal error of each gene".to_owned(),
        caption,
        panels,
        columns: 2,
        numbers: Numbers::Below,
    })
}

/// What the whole search space has at each value of a gene.
fn exact(grid: &Rows, gene: &str) -> Result<[Series; 2], Error> {
    let (genes, values) = (grid.texts("gene")?, grid.numbers("value")?);
    let line = |column: &str| -> Result<Vec<[f64; 2]>, Error> {
        let errors: Vec<f64> = grid.numbers(column)?.into_iter().map(percent).collect();
        let points = zip(&values, &errors).zip(&genes).filter(|(_, name)| *name == gene);
        Ok(points.map(|(point, _)| point).collect())
    };
    Ok([
        Series::dashed("all descriptors: mean", Colour::Blue, Dash::Dashed, line("mean_object_error")?),
        Series::dashed("all descriptors: best", Colour::Vermillion, Dash::Solid, line("best_object_error")?),
    ])
}

fn vary<'a>(mut values: impl Iterator<Item = &'a f64>) -> bool {
    let first = values.next();
    values.any(|value| Some(value) != first)
}

fn gene_axis(gene: &GeneColumn) -> Axis {
    Axis::numbers(&gene.name, &gene.unit)
}

/// Errors met at one value.
struct Met {
    lowest: f64,
    sum: f64,
    count: u32,
}

impl Default for Met {
    fn default() -> Self {
        Self { lowest: f64::INFINITY, sum: 0.0, count: 0 }
    }
}

impl Met {
    fn add(&mut self, error: f64) {
        self.lowest = self.lowest.min(error);
        self.sum += error;
        self.count += 1;
    }

    fn mean(&self) -> f64 {
        self.sum / f64::from(self.count)
    }
}
