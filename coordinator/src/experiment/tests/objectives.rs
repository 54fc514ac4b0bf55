//! `search.objectives`: what it means, what is refused, and how it is written out again.

use expect_test::expect;

use super::messages::check;
use super::*;
use crate::objectives::SearchObjective::{self, Cost, Error, Size};

/// A file of when the key was new.
pub(super) const SAMPLE: &str = include_str!("../../../testdata/experiment-v1-objectives.toml");

fn objectives(lines: &str) -> Vec<SearchObjective> {
    parse(&format!("{LEAST}{lines}")).unwrap().objectives().each().collect()
}

#[test]
fn nsga2_has_all_three_unless_they_are_written_and_other_methods_have_the_error() {
    assert_eq!(objectives(""), [Error]);
    assert_eq!(objectives("search.objectives = ['error']"), [Error]);
    assert_eq!(objectives("search.method = 'nsga2'"), [Error, Cost, Size]);
    assert_eq!(objectives("search.method = 'nsga2'\nsearch.objectives = ['size', 'error']"), [Error, Size]);
    assert_eq!(parse(SAMPLE).unwrap().objectives().each().collect::<Vec<_>>(), [Error, Size]);
    // Such a search goes on when nothing is wrong any more, unless it is told not to.
    let perfect = |lines: &str| parse(&format!("{LEAST}{lines}")).unwrap().stop().perfect;
    assert!(perfect("search.method = 'ga'") && !perfect("search.method = 'nsga2'"));
    assert!(perfect("search.method = 'nsga2'\nstop.perfect = true"));
}

#[test]
fn what_no_search_minimises_is_refused_by_name() {
    check(
        &[
            "search.method = 'nsga2'\nsearch.objectives = ['error', 'speed']",
            "search.method = 'nsga2'\nsearch.objectives = ['error']",
            "search.method = 'nsga2'\nsearch.objectives = []",
            "search.method = 'nsga2'\nsearch.objectives = ['cost', 'size']",
            "search.method = 'nsga2'\nsearch.objectives = ['error', 'cost', 'error']",
            "search.method = 'nsga2'\nsearch.objectives = 'error'",
            "search.objectives = ['error', 'cost']",
            "search.method = 'random'\nsearch.objectives = ['error', 'cost', 'size']",
        ],
        expect![[r#"
            search.method = \'nsga2\'\nsearch.objectives = [\'error\', \'speed\']
              search.objectives: unknown word, got 'speed'
              known words here: error, cost, size
            search.method = \'nsga2\'\nsearch.objectives = [\'error\']
              search.objectives: method nsga2 needs two or three, got ["error"]
              add "cost" or "size", or write method = "ga"
            search.method = \'nsga2\'\nsearch.objectives = []
              search.objectives: "error" must be among them, got []
              add it
            search.method = \'nsga2\'\nsearch.objectives = [\'cost\', \'size\']
              search.objectives: "error" must be among them, got ["cost", "size"]
              add it
            search.method = \'nsga2\'\nsearch.objectives = [\'error\', \'cost\', \'error\']
              search.objectives: each must be named once, got "error" twice
              remove one of them
            search.method = \'nsga2\'\nsearch.objectives = \'error\'
              search.objectives: expected a list, got 'error'
              write values in brackets, with commas between them
            search.objectives = [\'error\', \'cost\']
              search.objectives: method ga has one, "error", got ["error", "cost"]
              write method = "nsga2", or remove the key
            search.method = \'random\'\nsearch.objectives = [\'error\', \'cost\', \'size\']
              search.objectives: method random has one, "error", got ["error", "cost", "size"]
              write method = "nsga2", or remove the key
        "#]],
    );
}

#[test]
fn objectives_are_part_of_the_search_where_there_are_several() {
    let text = |lines: &str| parse(&format!("{LEAST}{lines}")).unwrap().search_toml();
    assert!(!text("").contains("objectives"));
    assert_eq!(text("search.objectives = ['error']"), text(""));
    let all = "objectives = [\"error\", \"cost\", \"size\"]\n";
    assert!(text("search.method = 'nsga2'").contains(&format!("method = \"nsga2\"\n{all}")));
    let order = "search.method = 'nsga2'\nsearch.objectives = ['size', 'cost', 'error']";
    assert_eq!(text(order), text("search.method = 'nsga2'"));
    for lines in
        ["search.method = 'nsga2'", order, "search.method = 'nsga2'\nsearch.objectives = ['error', 'size']"]
    {
        let experiment = parse(&format!("{LEAST}{lines}")).unwrap();
        let again = Experiment::parse(
            &experiment.record_toml(),
            Path::new("record"),
            Overrides::default(),
            &no_variables,
        );
        assert_eq!(again.unwrap().search_toml(), experiment.search_toml());
    }
}

#[test]
fn a_variant_of_one_objective_beside_a_base_of_several_is_read_again_from_the_record() {
    let lines = "search.method = 'nsga2'\n[sweep]\nseeds = [1, 2]\n[sweep.variants.one]\n\
        search = { method = 'ga', objectives = ['error'] }\n[sweep.variants.three]\nga.population = 20\n";
    let read = |text: &str| Plan::parse(text, Path::new("exp/x.toml"), Overrides::default(), &no_variables);
    let Plan::Sweep(sweep) = read(&format!("{LEAST}{lines}")).unwrap() else { panic!("a sweep") };
    let record = sweep.record_toml();
    let Plan::Sweep(again) = read(&record).unwrap() else { panic!("a sweep") };
    assert_eq!(again.search_toml(), sweep.search_toml());
    let of_one: Vec<_> =
        again.members().iter().map(|member| member.experiment.objectives().are_several()).collect();
    assert_eq!(of_one, [false, false, true, true]);
}

#[test]
fn the_random_control_of_any_search_is_read_again_from_its_record() {
    for sample in [SAMPLE, super::SAMPLE] {
        let experiment = parse(sample).unwrap();
        let control = experiment.random_control(300);
        assert_eq!((control.method(), control.objectives()), (Method::Random, Objectives::ERROR));
        assert_eq!(control.stop().evaluations, Some(300));
        assert_eq!(control.space_toml(), experiment.space_toml());
        assert_eq!(parse(&control.resolved_toml()), Ok(control));
    }
}
