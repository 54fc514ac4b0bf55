//! Measured quantities at growing sizes, and the exponents of their growth.

use std::fmt;

/// What is measured.
#[derive(Clone, Copy)]
pub struct Quantity {
    pub what: &'static str,
    pub write: fn(f64) -> String,
}

/// Quantities by a size.
pub struct Growth {
    /// The size's name in files.
    pub by: &'static str,
    /// Its unit.
    pub unit: &'static str,
    pub quantities: Vec<Quantity>,
    /// Sizes, each with what was measured there.
    pub measured: Vec<(f64, Vec<f64>)>,
}

impl Growth {
    pub fn new(by: &'static str, unit: &'static str, quantities: &[Quantity]) -> Self {
        Self { by, unit, quantities: quantities.to_vec(), measured: Vec::new() }
    }

    /// Adds what was measured at a size.
    pub fn add(&mut self, size: f64, values: Vec<f64>) {
        assert_eq!(values.len(), self.quantities.len(), "a value of each quantity");
        self.measured.push((size, values));
    }

    /// Sizes and values of a quantity.
    pub fn series(&self, quantity: usize) -> Vec<(f64, f64)> {
        self.measured.iter().map(|(size, values)| (*size, values[quantity])).collect()
    }
}

impl fmt::Display for Growth {
    /// Markdown.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let heads: Vec<String> =
            self.measured.iter().map(|(size, _)| format!("{size:.0} {}", self.unit)).collect();
        writeln!(f, "| what | {} | exponent | of the last step |", heads.join(" | "))?;
        writeln!(f, "|---|{}---|---|", "---|".repeat(heads.len()))?;
        for (number, Quantity { what, write }) in self.quantities.iter().enumerate() {
            let series = self.series(number);
            let cells: Vec<String> = series.iter().map(|(_, value)| write(*value)).collect();
            let [all, last] = [exponent(&series), exponent(&series[series.len() - 2..])];
            writeln!(f, "| {what} | {} | {all:.2} | {last:.2} |", cells.join(" | "))?;
        }
        Ok(())
    }
}

/// Slope of the least-squares line through the logarithms.
#[expect(clippy::disallowed_methods, reason = "describes a measurement, which no two machines share")]
pub fn exponent(series: &[(f64, f64)]) -> f64 {
    let logarithms: Vec<(f64, f64)> = series.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let mean =
        |value: fn(&(f64, f64)) -> f64| logarithms.iter().map(value).sum::<f64>() / series.len() as f64;
    let (x_mean, y_mean) = (mean(|point| point.0), mean(|point| point.1));
    let covariance: f64 = logarithms.iter().map(|(x, y)| (x - x_mean) * (y - y_mean)).sum();
    let variance: f64 = logarithms.iter().map(|(x, _)| (x - x_mean) * (x - x_mean)).sum();
    covariance / variance
}
