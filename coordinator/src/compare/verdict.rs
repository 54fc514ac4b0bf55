//! What a comparison says of the run's descriptor, in sentences: whether it is better, how sure that is, at what price.

use std::path::Path;

use descriptor::FixedKind;
use descriptor::recogniser::Method;
use results::{ComparedRow, FrontRow, PairRow, RunRow};

use super::candidate::{EVOLVED, PAPER, point_name};
use super::difference::{Difference, correct, differences, price};
use super::pairs::Level;

/// A sentence on the run's descriptor against the paper's, and one against that of the others with fewest errors; and of
/// each recogniser that learns one against the nearest cloud, and one against the others by the same recogniser. None
/// where there is nothing to set it against. Last, one on the points of the run's `front` against PFHRGB, where the table
/// has both. Errors are of what the run's fitness counts.
pub fn verdict(level: Level, rows: &[ComparedRow], pairs: &[PairRow], front: &[FrontRow]) -> Vec<String> {
    let of_method = |method: Method| {
        let differences = differences(rows, pairs, (level, method));
        let first = match method {
            Method::Nearest => PAPER,
            _ => EVOLVED,
        };
        let (first, others): (Vec<_>, Vec<_>) =
            differences.into_iter().partition(|one| one.other.descriptor == first);
        // Each on the clouds that the run's describes, too: one that describes few of them may have few errors.
        let best = others.into_iter().min_by(|a, b| a.points.total_cmp(&b.points));
        first.into_iter().chain(best).map(|one| one.sentence()).collect::<Vec<_>>()
    };
    Method::ALL
        .into_iter()
        .flat_map(of_method)
        .chain(points_against_pfhrgb(level, rows, pairs, front))
        .collect()
}

/// The verdict of a run, from the tables of its folder: nothing where there is no comparison.
///
/// # Errors
/// If a table cannot be read.
pub fn verdict_of_run(folder: &Path, run: &RunRow) -> Result<Vec<String>, results::Error> {
    let (rows, pairs) = (results::read_comparison(folder)?, results::read_pairs(folder)?);
    Ok(verdict(Level::of(run), &rows, &pairs, &results::read_front(folder)?))
}

/// Which of the front's points in the table is the fastest that is better than PFHRGB. Fast means a low counted cost: that
/// is the same on every machine, and known of points whose time nobody has measured.
fn points_against_pfhrgb(
    level: Level,
    rows: &[ComparedRow],
    pairs: &[PairRow],
    front: &[FrontRow],
) -> Option<String> {
    let row = |name: &str| rows.iter().find(|row| row.descriptor == name);
    let pfhrgb = row(FixedKind::PfhRgb.name())?;
    let against = |point: &FrontRow| {
        Some((Difference::between(level, [row(&point_name(point.point))?, pfhrgb], pairs)?, point.cost))
    };
    let (mut compared, costs): (Vec<_>, Vec<u64>) = front.iter().filter_map(against).unzip();
    correct(&mut compared);
    let better = compared.iter().zip(costs).filter(|(one, _)| one.points > 0.0 && one.is_sure());
    let order = |(a, cost): &(&Difference<'_>, u64), (b, other): &(&Difference<'_>, u64)| {
        cost.cmp(other).then(b.points.total_cmp(&a.points))
    };
    let fastest = better.min_by(order); // the first of equals
    let best = compared.iter().min_by(|a, b| b.points.total_cmp(&a.points))?;
    Some(match (&compared[..], fastest) {
        ([only], _) => only.sentence(),
        (all, Some((fastest, _))) => format!(
            "of the {} compared points, {} is the fastest that is better than {}: {}{}",
            all.len(),
            fastest.own.descriptor,
            pfhrgb.descriptor,
            fastest.errors(),
            price(fastest.own, pfhrgb)
        ),
        (all, None) => format!(
            "no evidence that any of the {} compared points is better than {}: {}, the best of them, has {}",
            all.len(),
            pfhrgb.descriptor,
            best.own.descriptor,
            best.errors()
        ),
    })
}

#[cfg(test)]
mod tests {
    use results::{Counts, Times, mcnemar};

    use super::super::pairs::{SIGNIFICANCE, probability};

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
            size: Some(9),
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
            cloud_seconds: None,
            times: seconds.map(times),
            area: None,
            nearest_area: None,
            bytes: None,
            file_digest: None,
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
        said_with(rows, &[])
    }

    fn said_with(rows: &[ComparedRow], front: &[FrontRow]) -> Vec<String> {
        let all = rows.iter().enumerate();
        let pairs = all.flat_map(|(place, a)| rows[place + 1..].iter().map(move |b| pair(a, b)));
        verdict(Level::Object, rows, &pairs.collect::<Vec<_>>(), front)
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
    fn errors_are_those_on_the_clouds_that_both_describe() {
        // Of 200 clouds the other describes 100, and recognises 90 of them; the run's recognises 80 of these, 140 in all.
        let own = row("evolved", 140, None);
        let counts = Counts { object_correct: 90, category_correct: 90, queries: 100 };
        let other = ComparedRow { counts, skipped: 100, ..row("paper", 90, None) };
        let common = PairRow {
            both_right: 75,
            only_a: 5,
            only_b: 15,
            both_wrong: 5,
            p_value: mcnemar(5, 15),
            ..pair(&own, &other)
        };
        let rows = [own, other];
        let [sentence] = &verdict(Level::Object, &rows, &[common], &[])[..] else { panic!("one sentence") };
        assert!(
            sentence.starts_with(
                "evolved is worse than paper: 20.00 % of the 100 clouds that both describe wrong instead of 10.00 %, 10.00 \
                 points more"
            ),
            "{sentence}"
        );
    }

    #[test]
    fn the_best_of_the_others_is_not_one_that_describes_few_clouds() {
        let own = row("evolved", 150, None);
        let all = row("pfhrgb", 150, None);
        // Of the ten clouds that it describes it recognises nine, and the run's descriptor all.
        let counts = Counts { object_correct: 9, category_correct: 9, queries: 10 };
        let few = ComparedRow { counts, skipped: 190, ..row("few", 9, None) };
        let common = PairRow { both_right: 9, only_a: 1, only_b: 0, both_wrong: 0, ..pair(&own, &few) };
        let pairs = [pair(&own, &all), common];
        let sentences = verdict(Level::Object, &[own, all, few], &pairs, &[]);
        assert_eq!(sentences.len(), 1);
        assert!(
            sentences[0].contains("evolved and pfhrgb have equally many clouds wrong: 25.00 %"),
            "{sentences:?}"
        );
    }

    #[test]
    fn a_search_for_categories_is_judged_by_them() {
        let rows = [row("evolved", 140, None), row("paper", 180, None)];
        let of_objects = pair(&rows[0], &rows[1]);
        let of_categories = PairRow {
            level: Level::Category.name().to_owned(),
            both_right: 190,
            only_a: 10,
            only_b: 0,
            both_wrong: 0,
            p_value: mcnemar(10, 0),
            ..of_objects.clone()
        };
        let sentences = verdict(Level::Category, &rows, &[of_objects, of_categories], &[]);
        assert!(
            sentences[0].starts_with(
                "evolved is better than paper: 0.00 % of clouds taken for another category instead of 5.00 %, 5.00 points \
                 fewer"
            ),
            "{sentences:?}"
        );
    }

    #[test]
    fn what_takes_hardly_any_time_does_not_take_none() {
        let said = said(&[row("evolved", 140, Some(0.001)), row("paper", 180, Some(4.0))]);
        assert!(said[0].contains("in less than 1 % of the time"), "{said:?}");
    }

    #[test]
    fn how_others_differ_among_themselves_weakens_no_evidence() {
        // 12 clouds more of 200: p = 0.0005, which 21 comparisons of others with each other would make 0.01.
        let own = row("evolved", 162, None);
        let others: Vec<ComparedRow> =
            (0..7).map(|other| row(&format!("other-{other}"), 150, None)).collect();
        let rows: Vec<ComparedRow> = std::iter::once(own).chain(others).collect();
        let all = rows.iter().enumerate();
        let pairs: Vec<PairRow> =
            all.flat_map(|(place, a)| rows[place + 1..].iter().map(move |b| pair(a, b))).collect();
        let found = differences(&rows, &pairs, (Level::Object, Method::Nearest));
        assert_eq!(found.len(), 7);
        for one in found {
            assert_eq!((one.points, one.is_sure()), (6.0, true));
            assert!((one.p - 7.0 * mcnemar(12, 0)).abs() < 1e-12);
        }
    }

    #[test]
    fn what_is_learned_is_set_against_the_nearest_cloud_and_its_like() {
        let by = |descriptor: &str, right| ComparedRow {
            recogniser: Some("projection".to_owned()),
            ..row(descriptor, right, None)
        };
        let rows = [
            row("evolved", 160, None),
            row("paper", 150, None),
            by("evolved-projection", 190),
            by("paper-projection", 170),
            by("pfhrgb-projection", 186),
            by("evolved-l1-projection", 199),
        ];
        let sentences = said(&rows);
        let begins = [
            "evolved is better than paper",
            "evolved-projection is better than evolved:",
            "no evidence that evolved-projection differs from pfhrgb-projection",
        ];
        assert_eq!(sentences.len(), begins.len(), "{sentences:?}");
        for (sentence, begin) in sentences.iter().zip(begins) {
            assert!(sentence.starts_with(begin), "{sentence}");
        }
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
        assert_eq!(sentences.len(), 4, "{sentences:?}");
        let ends =
            ["than paper: ", "differs from pfhrgb: ", "than evolved: ", "pfhrgb-projection have equally"];
        for (sentence, end) in sentences.iter().zip(ends) {
            assert!(sentence.contains(end), "{sentence}");
        }
        assert_eq!(said(&rows[2..]), Vec::<String>::new());
        assert_eq!(said(&[rows[0].clone(), rows[2].clone()]), Vec::<String>::new());
        // No query is described by both.
        assert_eq!(verdict(Level::Object, &rows, &[], &[]), Vec::<String>::new());
    }

    #[test]
    fn a_name_that_has_l1_in_it_is_of_a_descriptor_like_others() {
        let rows = [row("evolved", 180, None), row("paper", 150, None), row("unet-l16", 120, None)];
        let sentences = said(&rows);
        assert!(sentences.iter().any(|sentence| sentence.contains("unet-l16")), "{sentences:?}");
    }

    /// A front of points with these counted costs.
    fn front(costs: &[u64]) -> Vec<FrontRow> {
        let row = |(point, &cost): (u32, &u64)| FrontRow {
            point,
            generation: 1,
            individual: point,
            chromosome: String::new(),
            genes: Vec::new(),
            train: Counts { object_correct: 1, category_correct: 1, queries: 1 },
            objective_correct: None,
            train_margin: None,
            validation: None,
            validation_margin: None,
            cost,
            size: 9,
            winner: point == 1,
        };
        (1..).zip(costs).map(row).collect()
    }

    /// What is said last of PFHRGB with 150 right of 200 and of points with so many, of a front of these costs.
    fn of_points(right: &[(u32, u32)], costs: &[u64]) -> Option<String> {
        let points = right.iter().map(|&(point, right)| row(&format!("point-{point}"), right, None));
        let rows: Vec<ComparedRow> = std::iter::once(row("pfhrgb", 150, None)).chain(points).collect();
        let sentences = said_with(&rows, &front(costs));
        assert!(sentences.len() < 2, "{sentences:?}");
        sentences.into_iter().next()
    }

    #[test]
    fn of_points_the_fastest_that_is_better_than_pfhrgb_is_named() {
        // Point 4 is the fastest, and no better; 2 is slower than 3 and has fewer errors; 5 is not compared.
        let costs = [900, 500, 300, 100, 50];
        let found = of_points(&[(1, 190), (2, 180), (3, 170), (4, 150)], &costs).unwrap();
        let p = probability(2.0 * mcnemar(20, 0)); // that of two others is smaller still
        assert_eq!(
            found,
            format!(
                "of the 4 compared points, point-3 is the fastest that is better than pfhrgb: 15.00 % of clouds wrong \
                 instead of 25.00 %, 10.00 points fewer (95 % interval 8.0 to 11.0, p {p}), with 340 values a cloud \
                 instead of 300"
            )
        );
        // Of equally fast ones that with fewer errors, of those the first.
        let named = |right: &[(u32, u32)], costs: &[u64], point: u32| {
            let found = of_points(right, costs).unwrap();
            assert!(found.contains(&format!(" points, point-{point} is the fastest")), "{found}");
        };
        named(&[(1, 170), (2, 180), (3, 180)], &[7, 7, 7], 2);
        // Fewer of the clouds that both recognise is no better.
        named(&[(1, 120), (2, 180)], &[1, 2], 2);
        // Whichever comes first in the table.
        let rows = [row("point-1", 180, None), row("point-2", 170, None), row("pfhrgb", 150, None)];
        let found = said_with(&rows, &front(&[2, 1])).remove(0);
        assert!(found.contains("point-2 is the fastest") && found.contains("10.00 points fewer"), "{found}");
    }

    #[test]
    fn points_are_corrected_for_one_another_and_for_nothing_else() {
        // Seven clouds more of 200: p = 0.016 of one point, 0.031 of two, 0.062 of four.
        assert_eq!(
            [1, 2, 4].map(|points| f64::from(points) * mcnemar(7, 0) < SIGNIFICANCE),
            [true, true, false]
        );
        let seven_more = |points: u32| {
            let right: Vec<(u32, u32)> = (1..=points).map(|point| (point, 157)).collect();
            of_points(&right, &[5, 4, 3, 2]).unwrap()
        };
        assert!(
            seven_more(1).starts_with("point-1 is better than pfhrgb: 21.50 % of clouds wrong instead of 25")
        );
        assert!(seven_more(2).starts_with("of the 2 compared points, point-2 is the fastest that is better"));
        let none = seven_more(4);
        assert!(
            none.starts_with(
                "no evidence that any of the 4 compared points is better than pfhrgb: point-1, the best of them, has \
                 21.50 % of clouds wrong instead of 25.00 %, but 3.50 points fewer may be chance (95 % interval 1.5 to 4.5, \
                 p = 0.06"
            ),
            "{none}"
        );
        // Holm: the smallest p is multiplied by four, and the others are no smaller after that than it.
        let found = of_points(&[(1, 180), (2, 158), (3, 157), (4, 150)], &[9, 8, 7, 6]).unwrap();
        assert!([3.0 * mcnemar(8, 0), 2.0 * mcnemar(7, 0)].iter().all(|p| *p < SIGNIFICANCE));
        assert!(found.contains("point-3 is the fastest"), "{found}");
        // The run's own descriptor, and other recognisers and distances, do not count.
        let more = ["evolved", "point-2-l1", "point-2-projection", "paper"].map(|name| row(name, 199, None));
        let rows: Vec<ComparedRow> =
            [row("pfhrgb", 150, None), row("point-2", 157, None)].into_iter().chain(more).collect();
        let last = said_with(&rows, &front(&[2, 1])).pop().unwrap();
        assert!(last.starts_with("point-2 is better than pfhrgb"), "{last}");
    }

    #[test]
    fn points_that_are_no_better_or_not_there_are_not_praised() {
        let said = |right: &[(u32, u32)]| of_points(right, &[3, 2, 1]).unwrap_or_default();
        let begins = "no evidence that any of the 2 compared points is better than pfhrgb: point-3, the best of them, has ";
        assert_eq!(said(&[(1, 149), (3, 150)]), format!("{begins}25.00 % of clouds wrong, as pfhrgb has"));
        let worse = said(&[(1, 100), (3, 120)]);
        assert!(
            worse.starts_with(&format!(
                "{begins}40.00 % of clouds wrong instead of 25.00 %, 15.00 points more ("
            )),
            "{worse}"
        );
        assert!(said(&[(2, 120)]).starts_with("point-2 is worse than pfhrgb"));
        assert_eq!(said(&[]), "");
        // A run without a front, and a table without PFHRGB.
        assert_eq!(of_points(&[(1, 190)], &[]), None);
        assert_eq!(said_with(&[row("point-1", 190, None)], &front(&[1])), Vec::<String>::new());
    }
}
