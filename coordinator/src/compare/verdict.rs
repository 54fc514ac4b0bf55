//! What a comparison says of the run's descriptor, in sentences: whether it is better, how sure that is, at what price.

use results::{ComparedRow, PairRow, Times};

use super::candidate::{EVOLVED, L1_SUFFIX, PAPER};
use super::differences::{Level, SIGNIFICANCE, probability};
use crate::run::progress::percent;

/// A sentence on the run's descriptor against the paper's, and one against that of the others with fewest errors; none
/// where there is nothing to set it against. Like is set against like: descriptors by χ² and the nearest cloud.
pub fn verdict(rows: &[ComparedRow], pairs: &[PairRow]) -> Vec<String> {
    let named = |name: &str| rows.iter().find(|row| row.descriptor == name);
    let Some(own) = named(EVOLVED) else { return Vec::new() };
    let is_other = |row: &&ComparedRow| {
        let is_alike = row.recogniser == own.recogniser && !row.descriptor.ends_with(L1_SUFFIX);
        is_alike && ![EVOLVED, PAPER].contains(&row.descriptor.as_str())
    };
    let error = |row: &ComparedRow| row.counts.object_error();
    let best = rows.iter().filter(is_other).min_by(|a, b| error(a).total_cmp(&error(b)));
    [named(PAPER), best].into_iter().flatten().filter_map(|other| against(own, other, pairs)).collect()
}

/// The run's descriptor against another; `None` if no query is described by both.
fn against(own: &ComparedRow, other: &ComparedRow, pairs: &[PairRow]) -> Option<String> {
    let names = [&own.descriptor, &other.descriptor];
    let is_pair = |pair: &&PairRow| {
        let compared = [&pair.descriptor_a, &pair.descriptor_b];
        pair.level == Level::Object.name() && names.iter().all(|name| compared.contains(name))
    };
    let pair = pairs.iter().find(is_pair)?;
    // By how many points the other has more errors, and the interval of that.
    let sign = if pair.descriptor_a == own.descriptor { -100.0 } else { 100.0 };
    let points = sign * pair.error_difference();
    // Rounded here, so that nothing is said to be -0.0.
    let end = |end: f64| (10.0 * sign * points.signum() * end).round() / 10.0 + 0.0;
    let ends = [pair.difference_low, pair.difference_high].map(end);
    let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
    let p = probability(pair.p_adjusted);
    let p = if p.starts_with('<') { format!("p {p}") } else { format!("p = {p}") };
    let how_sure = format!("95 % interval {low:.1} to {high:.1}, {p}");
    let name = &other.descriptor;
    let [own_error, other_error] = [own, other].map(|row| percent(row.counts.object_error()));
    let more = if points > 0.0 { "fewer" } else { "more" };
    let distance = points.abs();
    let found = if pair.p_adjusted < SIGNIFICANCE {
        let better = if points > 0.0 { "better" } else { "worse" };
        format!(
            "{EVOLVED} is {better} than {name}: {own_error} of clouds wrong instead of {other_error}, {distance:.2} points \
             {more} ({how_sure})"
        )
    } else if points == 0.0 {
        format!("{EVOLVED} and {name} have equally many clouds wrong: {own_error}")
    } else {
        format!(
            "no evidence that {EVOLVED} differs from {name}: {own_error} of clouds wrong instead of {other_error}, but \
             {distance:.2} points {more} may be chance ({how_sure})"
        )
    };
    Some(found + &price(own, other))
}

/// What it costs against another.
fn price(own: &ComparedRow, other: &ComparedRow) -> String {
    let seconds = |row: &ComparedRow| row.times.as_ref().map(Times::signatures);
    let times = seconds(own).zip(seconds(other)).filter(|(_, other)| *other > 0.0);
    let time = times.map(|(own, other)| match own / other {
        ratio if ratio < 1.0 => format!("in {:.0} % of the time", 100.0 * ratio),
        ratio => format!("in {ratio:.1} times the time"),
    });
    let sizes = own.cloud_size.zip(other.cloud_size);
    let size = sizes.map(|(own, other)| format!("with {own} values a cloud instead of {other}"));
    let parts: Vec<String> = time.into_iter().chain(size).collect();
    if parts.is_empty() { String::new() } else { format!(", {}", parts.join(" and ")) }
}

#[cfg(test)]
mod tests {
    use results::{Counts, mcnemar};

    use super::*;

    /// A row of a descriptor that recognises so many of 200 clouds.
    fn row(descriptor: &str, right: u32, seconds: Option<f64>) -> ComparedRow {
        let times = |describe| Times {
            read: 9.0,
            keypoints: 0.0,
            normals: 0.0,
            describe,
            matching: 9.0,
            total: 20.0,
            hardware: "a processor".to_owned(),
        };
        ComparedRow {
            descriptor: descriptor.to_owned(),
            kind: "structure".to_owned(),
            distance: "chi2".to_owned(),
            parameters: String::new(),
            size: 9,
            recogniser: Some("nearest".to_owned()),
            cloud_size: Some(2 * right),
            settings: None,
            database_error: None,
            note: None,
            counts: Counts { object_correct: right, category_correct: right, queries: 200 },
            object_wilson: [0.0, 1.0],
            category_wilson: [0.0, 1.0],
            object_bootstrap: [0.0, 1.0],
            category_bootstrap: [0.0, 1.0],
            skipped: 0,
            database: 9,
            keypoints_per_cloud: None,
            times: seconds.map(times),
            area: None,
            nearest_area: None,
            bytes: None,
        }
    }

    /// Of two descriptors, where all that only one recognises is the difference.
    fn pair(a: &ComparedRow, b: &ComparedRow) -> PairRow {
        let [right_a, right_b] = [a, b].map(|row| row.counts.object_correct);
        let [only_a, only_b] = [right_a.saturating_sub(right_b), right_b.saturating_sub(right_a)];
        let difference = (f64::from(only_b) - f64::from(only_a)) / 200.0;
        let p_value = mcnemar(only_a, only_b);
        PairRow {
            level: "object".to_owned(),
            descriptor_a: a.descriptor.clone(),
            descriptor_b: b.descriptor.clone(),
            both_right: right_a.min(right_b),
            only_a,
            only_b,
            both_wrong: 200 - right_a.max(right_b),
            difference_low: difference - 0.02,
            difference_high: difference + 0.01,
            p_value,
            p_adjusted: p_value,
        }
    }

    fn said(rows: &[ComparedRow]) -> Vec<String> {
        let all = rows.iter().enumerate();
        let pairs = all.flat_map(|(place, a)| rows[place + 1..].iter().map(move |b| pair(a, b)));
        verdict(rows, &pairs.collect::<Vec<_>>())
    }

    #[test]
    fn what_is_sure_is_said_with_its_price() {
        let rows = [row("evolved", 180, Some(3.0)), row("paper", 140, Some(2.0))];
        let better = "evolved is better than paper: 10.00 % of clouds wrong instead of 30.00 %, 20.00 points fewer \
            (95 % interval 19.0 to 22.0, p < 0.0001), in 1.5 times the time and with 360 values a cloud instead of 280";
        assert_eq!(said(&rows), [better]);
        // Whichever comes first in the table.
        let [own, paper] = rows;
        assert_eq!(said(&[paper, own])[0].replace("18.0 to 21.0", "19.0 to 22.0"), better);
        let worse = said(&[row("evolved", 140, Some(1.0)), row("paper", 180, Some(4.0))]);
        assert_eq!(
            worse,
            [
                "evolved is worse than paper: 30.00 % of clouds wrong instead of 10.00 %, 20.00 points more (95 % interval \
              18.0 to 21.0, p < 0.0001), in 25 % of the time and with 280 values a cloud instead of 360"
            ]
        );
    }

    #[test]
    fn what_may_be_chance_is_said_to_be() {
        let said_of = |right| said(&[row("evolved", right, None), row("paper", 150, None)]).remove(0);
        let more = said_of(152);
        assert!(
            more.starts_with("no evidence that evolved differs from paper: 24.00 % of clouds wrong"),
            "{more}"
        );
        assert!(
            more.contains("but 1.00 points fewer may be chance (95 % interval 0.0 to 3.0, p = 0.5"),
            "{more}"
        );
        let less = said_of(148);
        assert!(
            less.contains("but 1.00 points more may be chance (95 % interval -1.0 to 2.0, p = 0.5"),
            "{less}"
        );
        let same = said_of(150);
        assert!(
            same.starts_with("evolved and paper have equally many clouds wrong: 25.00 %, with"),
            "{same}"
        );
    }

    #[test]
    fn the_best_of_the_others_is_one_of_a_kind() {
        let learned = |descriptor: &str| ComparedRow {
            recogniser: Some("projection".to_owned()),
            ..row(descriptor, 199, None)
        };
        let rows = [
            row("evolved", 180, None),
            learned("evolved-projection"),
            row("evolved-l1", 190, None),
            row("paper", 150, None),
            row("pfhrgb", 185, None),
            row("pfhrgb-l1", 195, None),
            learned("pfhrgb-projection"),
            row("chroma", 120, None),
        ];
        let sentences = said(&rows);
        assert_eq!(sentences.len(), 2);
        assert!(
            sentences[0].contains("better than paper: ") && sentences[1].contains("differs from pfhrgb: ")
        );
        assert_eq!(said(&rows[..3]), Vec::<String>::new());
        assert_eq!(said(&rows[3..]), Vec::<String>::new());
        // No query is described by both.
        assert_eq!(verdict(&rows, &[]), Vec::<String>::new());
    }
}
