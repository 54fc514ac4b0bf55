//! The front of a search of several objectives: its points with what was measured of them, as rows, text and JSON.

use descriptor::{Descriptor, SearchSpace};
use evolution::Found;
use results::{Counts, ErrorRate, FrontRow};
use serde_json::{Value, json};

use crate::fitness::{Fitness, Measured};
use crate::lines::percent;

/// Most points that the text shows, beside those that are marked.
const SHOWN: usize = 10;

/// A point of the front of a search.
pub struct FrontPoint {
    /// Where it was found, with its scores.
    pub found: Found,
    /// What it stands for.
    pub descriptor: Descriptor,
    /// By the fitness.
    pub train: Measured,
    /// On the validation clouds; `None` if there are none.
    pub validation: Option<Measured>,
}

/// The rows of a front in its order.
pub fn rows(
    (space, fitness): (&SearchSpace, &Fitness),
    front: &[FrontPoint],
    winner: &Found,
) -> Vec<FrontRow> {
    let row = |(point, FrontPoint { found, descriptor, train, validation }): (u32, &FrontPoint)| FrontRow {
        point,
        generation: found.generation,
        individual: found.index,
        chromosome: found.individual.bit_string(),
        genes: space.values(descriptor),
        train: train.counts,
        objective_correct: fitness.objective_correct(&train.counts),
        train_margin: train.margin,
        validation: validation.map(|measured| measured.counts),
        validation_margin: validation.and_then(|measured| measured.margin),
        cost: descriptor.recognition_cost(),
        size: descriptor.size_of_cloud(),
        winner: (found.generation, found.index) == (winner.generation, winner.index),
    };
    (1..).zip(front).map(row).collect()
}

/// Queries that are wrong by what the fitness counts.
fn errors(row: &FrontRow, counts: Counts) -> ErrorRate {
    if row.objective_correct.is_some() { counts.category_errors() } else { counts.object_errors() }
}

/// The errors that points are compared by: on validation clouds where there are any.
fn judged(row: &FrontRow) -> ErrorRate {
    errors(row, row.validation.unwrap_or(row.train))
}

/// Of the points whose error lies within the 95 % interval of the best one's, the smallest and the fastest, as indices.
/// `effective`: how many clouds that error is worth, where that is not the number of queries.
fn within_one_interval(rows: &[FrontRow], effective: Option<f64>) -> Option<[usize; 2]> {
    let best = rows.iter().map(judged).min_by(|a, b| a.share().total_cmp(&b.share()))?;
    let [_, end] = best.interval_of(effective);
    let near: Vec<usize> = (0..rows.len()).filter(|&row| judged(&rows[row]).share() <= end).collect();
    let least = |value: fn(&FrontRow) -> u64| {
        let order = |&row: &usize| (value(&rows[row]), judged(&rows[row]).wrong);
        near.iter().copied().min_by_key(order) // the first of equals
    };
    Some([least(|row| row.size)?, least(|row| row.cost)?])
}

/// What there is to say of each point.
fn marks(rows: &[FrontRow], effective: Option<f64>) -> Vec<Vec<&'static str>> {
    let mut marks: Vec<Vec<&str>> =
        rows.iter().map(|row| Vec::from_iter(row.winner.then_some("winner"))).collect();
    if let Some([smallest, fastest]) = within_one_interval(rows, effective) {
        if smallest == fastest {
            marks[smallest].push("smallest and fastest within one interval of the best");
        } else {
            marks[smallest].push("smallest within one interval of the best");
            marks[fastest].push("fastest within one interval of the best");
        }
    }
    marks
}

/// The front as lines, those of its points that are marked and some between them: number, errors, cost, size. `None`
/// of searches of one objective.
pub fn lines(rows: &[FrontRow], effective: Option<f64>) -> Option<Vec<String>> {
    let (marks, last) = (marks(rows, effective), rows.len().checked_sub(1)?);
    // Evenly from end to end.
    let even: Vec<usize> = (0..SHOWN).map(|place| place * last / (SHOWN - 1)).collect();
    let shown: Vec<usize> =
        (0..rows.len()).filter(|row| even.contains(row) || !marks[*row].is_empty()).collect();
    let error = |rate: ErrorRate| format!("{} ({})", percent(rate.share()), rate.wrong);
    let line = |[point, train, validation, cost, size]: [&str; 5], mark: &str| {
        let line = format!("{point:<6}{train:<15}{validation:<15}{cost:>9}{size:>7}  {mark}");
        line.trim_end().to_owned()
    };
    let mut lines = vec![line(["point", "train error", "validation", "cost", "values"], "")];
    for row in shown.iter().copied() {
        let of = &rows[row];
        let FrontRow { point, train, validation, cost, size, .. } = of;
        let validation = validation.map_or_else(|| "-".to_owned(), |counts| error(errors(of, counts)));
        let cells =
            [point.to_string(), error(errors(of, *train)), validation, cost.to_string(), size.to_string()];
        let cells = cells.each_ref().map(String::as_str);
        let [first, others @ ..] = &marks[row][..] else {
            lines.push(line(cells, ""));
            continue;
        };
        lines.push(line(cells, if *first == "winner" { first } else { "" }));
        let below = if *first == "winner" { others } else { &marks[row][..] };
        lines.extend(below.iter().map(|mark| format!("      {mark}")));
    }
    let left = rows.len() - shown.len();
    if left > 0 {
        lines.push(format!("… {left} more, see table front"));
    }
    Some(lines)
}

/// The front as JSON; `None` of searches of one objective.
pub fn json(rows: &[FrontRow], effective: Option<f64>) -> Option<Value> {
    let (smallest, fastest) =
        within_one_interval(rows, effective).map(|[smallest, fastest]| (smallest, fastest))?;
    let point = |(index, row): (usize, &FrontRow)| {
        let train = errors(row, row.train);
        let validation = row.validation.map(|counts| errors(row, counts));
        json!({
            "point": row.point,
            "generation": row.generation,
            "individual": row.individual,
            "train_error": train.share(),
            "train_errors": train.wrong,
            "validation_error": validation.map(ErrorRate::share),
            "validation_errors": validation.map(|rate| rate.wrong),
            "cost": row.cost,
            "size": row.size,
            "winner": row.winner,
            "smallest_within_one_interval_of_the_best": index == smallest,
            "fastest_within_one_interval_of_the_best": index == fastest,
        })
    };
    Some(rows.iter().enumerate().map(point).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of 200 validation clouds with these errors, costs and sizes; the first is the winner.
    fn front(points: &[(u32, u64, u64)]) -> Vec<FrontRow> {
        let counts = |errors| Counts { object_correct: 200 - errors, category_correct: 200, queries: 200 };
        let row = |(point, &(errors, cost, size)): (u32, &(u32, u64, u64))| FrontRow {
            point,
            generation: 1,
            individual: point,
            chromosome: String::new(),
            genes: Vec::new(),
            train: counts(point),
            objective_correct: None,
            train_margin: None,
            validation: Some(counts(errors)),
            validation_margin: None,
            cost,
            size,
            winner: point == 1,
        };
        (1..).zip(points).map(row).collect()
    }

    #[test]
    fn the_smallest_and_the_fastest_are_those_within_the_interval_of_the_best() {
        // 20 of 200 are 10 %, with an interval from 6.6 to 14.9 %: up to 29 errors.
        let rows = front(&[(20, 90, 90), (29, 80, 40), (29, 50, 60), (30, 1, 1), (29, 80, 40)]);
        assert_eq!(within_one_interval(&rows, None), Some([1, 2]));
        let without: Vec<FrontRow> =
            rows.iter().map(|row| FrontRow { validation: None, ..row.clone() }).collect();
        // Of training clouds they have one to five errors.
        assert_eq!(within_one_interval(&without, None), Some([3, 3]));
        assert_eq!(within_one_interval(&[], None), None);
        // 20 of 200 queries that are worth 20 clouds: up to 30 %, 60 errors.
        assert_eq!(within_one_interval(&rows, Some(20.0)), Some([3, 3]));
        // No category is wrong.
        let categories: Vec<FrontRow> =
            rows.iter().map(|row| FrontRow { objective_correct: Some(200), ..row.clone() }).collect();
        assert_eq!(within_one_interval(&categories, None), Some([3, 3]));
    }

    #[test]
    fn a_long_front_is_shown_from_end_to_end_with_every_point_that_is_marked() {
        assert_eq!(lines(&[], None), None);
        let long: Vec<(u32, u64, u64)> =
            (0..40).map(|n| (20 + u32::from(n > 6) * 50, 900 - n, 400 - n)).collect();
        let text = lines(&front(&long), None).unwrap();
        expect_test::expect![[r#"
            point train error    validation          cost values
            1     0.50 % (1)     10.00 % (20)         900    400  winner
            5     2.50 % (5)     10.00 % (20)         896    396
            7     3.50 % (7)     10.00 % (20)         894    394
                  smallest and fastest within one interval of the best
            9     4.50 % (9)     35.00 % (70)         892    392
            14    7.00 % (14)    35.00 % (70)         887    387
            18    9.00 % (18)    35.00 % (70)         883    383
            22    11.00 % (22)   35.00 % (70)         879    379
            27    13.50 % (27)   35.00 % (70)         874    374
            31    15.50 % (31)   35.00 % (70)         870    370
            35    17.50 % (35)   35.00 % (70)         866    366
            40    20.00 % (40)   35.00 % (70)         861    361
            … 29 more, see table front"#]]
        .assert_eq(&text.join("\n"));
        assert!(text.iter().all(|line| line.chars().count() <= crate::lines::COLUMNS - 14));
        let short = lines(&front(&long[..9]), None).unwrap();
        assert_eq!(short.len(), 1 + 9 + 1);
    }
}
