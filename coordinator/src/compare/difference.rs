//! The run's descriptor against another on the same clouds: by how much it is better, how sure that is, at what price.

use descriptor::recogniser::Method;
use results::{ComparedRow, ErrorRate, PairRow, holm};

use super::candidate::{EVOLVED, L1_SUFFIX, label, split_label};
use super::pairs::{Level, SIGNIFICANCE, probability};
use crate::lines::percent;

/// The run's descriptor against another on the same clouds.
pub struct Difference<'a> {
    level: Level,
    /// The run's.
    pub own: &'a ComparedRow,
    /// The other.
    pub other: &'a ComparedRow,
    /// What either has wrong of the clouds that both describe, the run's first.
    errors: [ErrorRate; 2],
    /// By how many points the run's descriptor has fewer errors.
    pub points: f64,
    /// The 95 % interval of that, by the bootstrap over objects.
    interval: [f64; 2],
    /// McNemar's test after Holm, over all others that the run's descriptor is set against by this recogniser: how they
    /// differ among themselves says nothing of it.
    pub p: f64,
}

/// How the run's descriptor under a recogniser differs from the others. Like is set against like: descriptors by χ² and
/// the same recogniser, one that learns against the nearest cloud, too.
pub fn differences<'a>(
    rows: &'a [ComparedRow],
    pairs: &[PairRow],
    (level, method): (Level, Method),
) -> Vec<Difference<'a>> {
    let label = label(EVOLVED, method);
    let Some(own) = rows.iter().find(|row| row.descriptor == label) else { return Vec::new() };
    let is_other = |row: &&ComparedRow| {
        let by_l1 = split_label(&row.descriptor).0.ends_with(L1_SUFFIX);
        let is_alike = row.recogniser == own.recogniser && !by_l1;
        *row != own && (is_alike || row.descriptor == EVOLVED)
    };
    let mut differences: Vec<Difference<'a>> = rows
        .iter()
        .filter(is_other)
        .filter_map(|other| Difference::between(level, [own, other], pairs))
        .collect();
    correct(&mut differences);
    differences
}

/// Holm's correction for all of these.
pub fn correct(differences: &mut [Difference<'_>]) {
    let adjusted = holm(&differences.iter().map(|one| one.p).collect::<Vec<f64>>());
    differences.iter_mut().zip(adjusted).for_each(|(one, adjusted)| one.p = adjusted);
}

impl<'a> Difference<'a> {
    /// Of two descriptors, not corrected; `None` if no query is described by both.
    pub fn between(level: Level, [own, other]: [&'a ComparedRow; 2], pairs: &[PairRow]) -> Option<Self> {
        let names = [own.descriptor.as_str(), &other.descriptor];
        let is_pair = |pair: &&PairRow| {
            let compared = [pair.descriptor_a.as_str(), &pair.descriptor_b];
            pair.level == level.name() && names.iter().all(|name| compared.contains(name))
        };
        let pair = pairs.iter().find(is_pair)?;
        let [first, second] = pair.errors();
        let (sign, errors) =
            if pair.descriptor_a == names[0] { (-100.0, [first, second]) } else { (100.0, [second, first]) };
        let [a, b] = [pair.difference_low, pair.difference_high].map(|end| sign * end);
        let (points, interval) = (sign * pair.error_difference(), [a.min(b), a.max(b)]);
        Some(Self { level, own, other, errors, points, interval, p: pair.p_value })
    }

    /// Whether it is hardly chance.
    pub fn is_sure(&self) -> bool {
        self.p < SIGNIFICANCE
    }

    /// In words, with the price.
    pub fn sentence(&self) -> String {
        let Self { own, other, points, .. } = self;
        let [own_name, name] = [&own.descriptor, &other.descriptor];
        let found = if self.is_sure() {
            let better = if *points > 0.0 { "better" } else { "worse" };
            format!("{own_name} is {better} than {name}: {}", self.errors())
        } else if *points == 0.0 {
            let [error, _] = self.errors.map(|error| percent(error.share()));
            format!("{own_name} and {name} have equally many {} {}: {error}", self.clouds(), self.wrong())
        } else {
            format!("no evidence that {own_name} differs from {name}: {}", self.errors())
        };
        found + &price(own, other)
    }

    /// What clouds are that count as errors.
    fn wrong(&self) -> &'static str {
        self.level.wrong()
    }

    /// What the errors are of: both describe all test clouds, or there are some that one of them does not.
    fn clouds(&self) -> String {
        let [common, _] = self.errors.map(|error| error.queries);
        let all = |row: &ComparedRow| row.counts.queries + row.skipped;
        if common == all(self.own) {
            "clouds".to_owned()
        } else {
            format!("the {common} clouds that both describe")
        }
    }

    /// Both errors, how far apart they are, and how sure that is.
    pub fn errors(&self) -> String {
        let Self { other, errors, points, interval, p, .. } = self;
        // Rounded here, so that nothing is said to be -0.0.
        let end = |end: f64| (10.0 * points.signum() * end).round() / 10.0 + 0.0;
        let [a, b] = interval.map(end);
        let p = probability(*p);
        let p = if p.starts_with('<') { format!("p {p}") } else { format!("p = {p}") };
        let how_sure = format!("95 % interval {:.1} to {:.1}, {p}", a.min(b), a.max(b));
        let [own_error, other_error] = errors.map(|error| percent(error.share()));
        let (clouds, wrong) = (self.clouds(), self.wrong());
        if *points == 0.0 {
            return format!("{own_error} of {clouds} {wrong}, as {} has", other.descriptor);
        }
        let more = if *points > 0.0 { "fewer" } else { "more" };
        let [but, may_be_chance] = if self.is_sure() { [""; 2] } else { ["but ", " may be chance"] };
        let distance = points.abs();
        format!(
            "{own_error} of {clouds} {wrong} instead of {other_error}, {but}{distance:.2} points {more}{may_be_chance} \
             ({how_sure})"
        )
    }
}

/// What it costs against another.
pub fn price(own: &ComparedRow, other: &ComparedRow) -> String {
    let time = own.time_beside(other).map(|ratio| match ratio {
        ratio if ratio < 0.01 => "in less than 1 % of the time".to_owned(),
        ratio if ratio < 1.0 => format!("in {:.0} % of the time", 100.0 * ratio),
        ratio => format!("in {ratio:.1} times the time"),
    });
    let sizes = own.cloud_size.zip(other.cloud_size);
    let size = sizes.map(|(own, other)| format!("with {own} values a cloud instead of {other}"));
    let parts: Vec<String> = time.into_iter().chain(size).collect();
    if parts.is_empty() { String::new() } else { format!(", {}", parts.join(" and ")) }
}
