//! Several runs in tables: their groups, each run, and how sure their differences are.

use super::figures::quantile;
use super::html::Item;
use super::runs::{Group, Member, Runs};
use super::summary::interval_text;
use super::table::TableBlock;
use crate::statistics::{RankSum, holm, rank_sum};
use crate::tables::run::Counts;

/// Runs that are listed one by one.
const MOST_RUNS: usize = 200;

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    quantile(&values, 0.5)
}

/// The median and the ends of some percentages.
fn spread(values: impl Iterator<Item = f64> + Clone) -> String {
    let ends =
        values.clone().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
    median(values)
        .map_or_else(|| "–".to_owned(), |median| format!("{median:.2} ({:.2} – {:.2})", ends[0], ends[1]))
}

/// One row per group.
pub(crate) fn groups(groups: &[Group]) -> TableBlock {
    // Where variants have names, what is behind them is not said yet.
    let with_settings = groups.iter().any(|group| group.name != group.settings);
    let row = |Group { name, settings, members, .. }: &Group| {
        let evaluated = median(members.iter().map(|member| member.best.len() as f64));
        let mut row = vec![name.clone()];
        if with_settings {
            row.push(settings.clone());
        }
        row.extend([
            members.len().to_string(),
            evaluated.map_or_else(String::new, |evaluated| format!("{evaluated:.0}")),
            spread(members.iter().map(Member::training_error)),
            spread(members.iter().filter_map(Member::test_error)),
            spread(members.iter().filter_map(Member::regret)),
        ]);
        row
    };
    let mut head =
        vec!["runs of", "runs", "different descriptors", "training error, %", "test error, %", "regret, %"];
    if with_settings {
        head.insert(1, "which differs in");
    }
    TableBlock {
        caption:
            "Groups of runs that differ in their seed only: median, lowest and highest of their winners."
                .to_owned(),
        head: head.into_iter().map(str::to_owned).collect(),
        rows: groups.iter().map(row).collect(),
        texts: if with_settings { 2 } else { 1 },
    }
}

/// One row per run, which leads to the run's own report, and what to do where there is none.
pub(crate) fn members(runs: &Runs) -> Vec<Item> {
    let all = runs.groups.iter().flat_map(|group| &group.members);
    let count = all.clone().count();
    let row = |member: &Member| {
        let run = &member.run.row;
        let error = |counts: Option<Counts>| {
            counts
                .map_or_else(|| "–".to_owned(), |counts| format!("{:.2}", 100.0 * run.errors(counts).share()))
        };
        let interval = run.test.map(|test| interval_text(run.errors(test).interval()));
        vec![
            member.label.clone(),
            member.best.len().to_string(),
            error(Some(run.train)),
            error(run.validation),
            error(run.test),
            interval.unwrap_or_default(),
            member.run.run_digest.get(..12).unwrap_or(&member.run.run_digest).to_owned(),
        ]
    };
    let head = ["run", "descriptors", "training, %", "validation, %", "test, %", "95 %", "run digest"];
    let more = if count > MOST_RUNS { format!(" The first {MOST_RUNS} of {count}.") } else { String::new() };
    let table = TableBlock {
        caption: format!(
            "Object errors of the winner of each run, or category errors where its fitness counts categories, in the test with Wilson’s 95 % interval; descriptors: different ones \
             that were evaluated.{more}"
        ),
        head: head.map(str::to_owned).to_vec(),
        rows: all.clone().take(MOST_RUNS).map(row).collect(),
        texts: 1,
    };
    let addresses = all.clone().take(MOST_RUNS).map(|member| member.report.clone()).collect();
    let mut items = vec![Item::Links { table, addresses }];
    let without: Vec<&Member> = all.filter(|member| member.report.is_none()).collect();
    if let [first, ..] = without.as_slice() {
        items.push(Item::Missing(format!(
            "No report yet of {} runs: `coordinator report {}` writes that of {}.",
            without.len(),
            first.folder.display(),
            first.label
        )));
    }
    items
}

/// A comparison of two groups in one measure.
struct Comparison<'a> {
    measure: String,
    groups: [&'a Group; 2],
    medians: [f64; 2],
    ranks: RankSum,
}

/// Every pair of groups on the same clouds: the training error that they reach with as many evaluations, and the test
/// error of their winners. `None` if there is no pair with at least two runs each.
pub(crate) fn tests(groups: &[Group]) -> Option<TableBlock> {
    let mut comparisons = Vec::new();
    for (index, first) in groups.iter().enumerate() {
        for second in &groups[index + 1..] {
            if first.data_digest == second.data_digest {
                comparisons.extend(compared(first, second));
            }
        }
    }
    if comparisons.is_empty() {
        return None;
    }
    let p_values: Vec<f64> = comparisons.iter().map(|comparison| comparison.ranks.p_value).collect();
    let row = |(comparison, adjusted): (&Comparison<'_>, f64)| {
        let Comparison { measure, groups: [first, second], medians, ranks } = comparison;
        // The lower error is the better one: the chance that the first has it is that of the second being larger.
        let better = 1.0 - ranks.a12;
        vec![
            measure.clone(),
            format!("{} ({})", first.name, first.members.len()),
            format!("{} ({})", second.name, second.members.len()),
            format!("{:.2}", medians[0]),
            format!("{:.2}", medians[1]),
            format!("{better:.2} {}", size(better)),
            p_text(ranks.p_value),
            p_text(adjusted),
        ]
    };
    let head = ["error", "first (runs)", "second (runs)", "median, %", "median, %", "A12", "p", "p (Holm)"];
    Some(TableBlock {
        caption: "Whether one kind of search has lower errors than another. A12 (Vargha and Delaney): the chance that a \
                  run of the first kind has a lower error than one of the second, ties as a half; 0.5 is no difference. p: \
                  two-sided test of Mann and Whitney, and corrected for the number of comparisons in this table (Holm). \
                  Training errors are compared after equal numbers of different descriptors, test errors as the runs \
                  ended."
            .to_owned(),
        head: head.map(str::to_owned).to_vec(),
        rows: comparisons.iter().zip(holm(&p_values)).map(row).collect(),
        texts: 3,
    })
}

fn compared<'a>(first: &'a Group, second: &'a Group) -> Vec<Comparison<'a>> {
    let groups = [first, second];
    if groups.iter().any(|group| group.members.len() < 2) {
        return Vec::new();
    }
    let members = || groups.iter().flat_map(|group| &group.members);
    let budget = members().map(|member| member.best.len()).min().unwrap_or(0);
    let reached = |member: &Member| member.best_after(budget);
    let mut comparisons = Vec::new();
    for (measure, of) in [
        (format!("training, {budget} descriptors"), &reached as &dyn Fn(&Member) -> Option<f64>),
        ("test".to_owned(), &Member::test_error),
    ] {
        let values = groups.map(|group| group.members.iter().filter_map(of).collect::<Vec<f64>>());
        let medians = [0, 1].map(|which| median(values[which].iter().copied()));
        if let (Some(ranks), [Some(a), Some(b)]) = (rank_sum(&values[0], &values[1]), medians) {
            comparisons.push(Comparison { measure, groups, medians: [a, b], ranks });
        }
    }
    comparisons
}

/// Size of an effect as Vargha and Delaney call it.
fn size(a12: f64) -> &'static str {
    match (a12 - 0.5).abs() {
        effect if effect < 0.06 => "(negligible)",
        effect if effect < 0.14 => "(small)",
        effect if effect < 0.21 => "(medium)",
        _ => "(large)",
    }
}

/// A p-value as papers write it.
pub(crate) fn p_text(p: f64) -> String {
    if p < 0.0001 { "< 0.0001".to_owned() } else { format!("{p:.4}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::FinishedRun;
    use crate::tests::fixture;

    /// A group whose runs end after as many evaluations as there are numbers.
    fn group(name: &str, data_digest: &str, bests: [&[f64]; 3]) -> Group {
        let member = |best: &[f64]| Member {
            label: name.to_owned(),
            folder: std::path::PathBuf::new(),
            variant: None,
            report: None,
            run: FinishedRun { row: fixture::run(), genes: fixture::genes(), run_digest: String::new() },
            best: best.to_vec(),
        };
        let members = bests.map(member).to_vec();
        let (name, data_digest) = (name.to_owned(), data_digest.to_owned());
        Group { settings: name.clone(), name, data_digest, members }
    }

    #[test]
    fn kinds_of_search_are_compared_at_equal_numbers_of_evaluations() {
        // After two evaluations the first is ahead in every pair of runs, at their ends behind.
        let first = group("first", "d", [&[9.0, 1.0], &[9.0, 2.0], &[9.0, 3.0]]);
        let second = group("second", "d", [&[9.0, 8.0, 0.1], &[9.0, 7.0, 0.1, 0.1], &[9.0, 6.0, 0.1]]);
        let elsewhere = group("elsewhere", "other", [&[1.0], &[1.0], &[1.0]]);
        let table = tests(&[first, second, elsewhere]).unwrap();
        // Two of the twenty ways to divide six values are as far apart: p = 0.1. The winners, all the fixture's, are equal.
        let training = [
            "training, 2 descriptors",
            "first (3)",
            "second (3)",
            "2.00",
            "7.00",
            "1.00 (large)",
            "0.1000",
            "0.2000",
        ];
        assert_eq!(table.rows[0], training);
        assert_eq!(table.rows[1][5..], ["0.50 (negligible)", "1.0000", "1.0000"]);
        assert_eq!(table.rows.len(), 2, "other clouds cannot be compared with");
    }

    #[test]
    fn one_kind_of_search_or_single_runs_are_not_compared() {
        let mut alone = group("alone", "d", [&[1.0], &[1.0], &[1.0]]);
        assert_eq!(tests(std::slice::from_ref(&alone)), None);
        alone.members.truncate(1);
        assert_eq!(tests(&[alone, group("other", "d", [&[1.0], &[1.0], &[1.0]])]), None);
    }
}
