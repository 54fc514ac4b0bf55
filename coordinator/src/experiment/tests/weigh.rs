//! Experiments whose runs weigh the values of their winner.

use descriptor::weigh::Weighing;

use super::parse;
use crate::experiment::Experiment;

pub(super) const SAMPLE: &str = include_str!("../../../testdata/experiment-v1-weigh.toml");

const CHANNEL: &str =
    "[[descriptor.channel]]\npairs = \"cloud\"\nfeatures = [\"hue 4\"]\nradius_cm = 9\nweight = 1.0\n";

#[test]
fn a_search_that_weighs_says_so_and_one_that_does_not_is_what_it_was() {
    let sample = parse(SAMPLE).unwrap();
    assert_eq!(sample.weighs(), Some(Weighing::Jointly));
    let separately = parse(&SAMPLE.replace("jointly", "separately")).unwrap();
    assert_eq!(separately.weighs(), Some(Weighing::Separately));
    for (experiment, how) in [(sample, "jointly"), (separately, "separately")] {
        let toml = experiment.search_toml();
        assert!(toml.contains(&format!("\nweigh = \"{how}\"\n")), "{toml}");
        assert_eq!(parse(&experiment.resolved_toml()), Ok(experiment));
    }
    let off = ["weigh = \"off\"", ""].map(|key| parse(&SAMPLE.replace("weigh = \"jointly\"", key)).unwrap());
    assert!(off.iter().all(|experiment| experiment.weighs().is_none()));
    assert!(off.iter().all(|experiment| !experiment.search_toml().contains("weigh")));
}

#[track_caller]
fn refused(text: &str, complaint: &str) {
    let error = parse(text).map(|_: Experiment| ()).unwrap_err().to_string();
    assert!(error.contains(complaint) && error.lines().count() == 2, "{error}");
}

#[test]
fn only_structures_are_weighed_and_those_that_have_room_for_weights() {
    let family = "family = \"structure\"";
    for other in ["disk-ring", "global-hue"] {
        let text = SAMPLE.replace(family, &format!("family = \"{other}\""));
        refused(&text, &format!("search.weigh: needs structures, got family {other}\n"));
        parse(&text.replace("jointly", "off")).unwrap();
    }
    let text = |max_bins: u32| SAMPLE.replace(family, &format!("{family}\nmax_bins = {max_bins}"));
    parse(&text(500)).unwrap();
    refused(&text(501), "search.weigh: needs descriptor.max_bins of at most 500, got 501\n");

    let one = |channel: &str| format!("{SAMPLE}{channel}");
    parse(&one(CHANNEL)).unwrap();
    let weights = format!("{CHANNEL}value_weights = [1.0, 0.5, 0.5, 0.5]\n");
    refused(&one(&weights), "search.weigh: needs channels without value_weights, got some with\n");
    parse(&one(&weights).replace("jointly", "off")).unwrap();
    // 8 · 8 · 8 bins in a mean and as many in a deviation.
    let large = CHANNEL
        .replace("\"cloud\"", "\"keypoints\"")
        .replace("\"hue 4\"", "\"hue 8\", \"value 8\", \"saturation 8\"");
    refused(&one(&large), "search.weigh: needs channels of at most 1000 values, got 1024\n");
}
