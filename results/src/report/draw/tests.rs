//! Figures with names and numbers of all kinds, drawn in every way.

use super::super::figure::{Axis, Dash, Marks, Numbers, Symbol};
use super::*;

const NAMES: [&str; 6] =
    ["plain", "<script>alert(1)</script>", "a & \"b\" 'c'", "größe 物体", "\u{0}\u{1b}", ""];

fn figure(name: &str) -> Figure {
    let series = vec![
        Series::band(name, Colour::Blue, vec![[0.0, 1.0, 2.0], [1.0, 1.5, 3.0]]),
        Series::dashed(name, Colour::Blue, Dash::Dashed, vec![[0.0, 1.0], [1.0, 2.0]]),
        Series::points("b", Colour::Green, Symbol::Triangle, vec![[0.5, 0.5]]),
        Series::points("", Colour::Green, Symbol::Dot, vec![[0.5, 0.5], [0.7, 0.5]]),
        Series::segments("", Colour::Black, 5, vec![[[0.0, 1.0], [1.0, 1.0]]]),
    ];
    let [x, y] = ["x", "y"].map(|label| Axis::numbers(label, "cm"));
    let numbers = Panel { title: name.to_owned(), x, y, series, height: 200 };
    let cells = vec![vec![Some(1.0), None], vec![Some(0.0), Some(3.0)]];
    let marks = Marks::counts(cells, "clouds", true);
    let names = || Axis::names(name, vec![name.to_owned(), "other".to_owned()]);
    let series = vec![Series { name: String::new(), colour: Colour::Blue, marks }];
    let matrix = Panel { title: String::new(), x: names(), y: names(), series, height: 300 };
    Figure {
        id: "test".to_owned(),
        title: name.to_owned(),
        caption: String::new(),
        panels: vec![numbers, matrix],
        columns: 2,
        numbers: Numbers::Below,
    }
}

/// Every tag that is opened is closed in order, and nothing that came from outside is a tag.
#[track_caller]
fn expect_well_formed(document: &str) {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = document;
    while let Some((before, after)) = rest.split_once('<') {
        assert!(!before.contains('>'), "{before:?}");
        let (tag, after) = after.split_once('>').expect("an end of the tag");
        assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
        match tag.strip_prefix('/') {
            Some(name) => assert_eq!(open.pop(), Some(name)),
            None if tag.ends_with('/') => {}
            None => open.push(tag.split(' ').next().expect("a name")),
        }
        rest = after;
    }
    assert!(open.is_empty() && rest.trim().is_empty(), "{open:?} {rest:?}");
    assert!(!document.chars().any(|c| c.is_control() && c != '\n'));
}

#[test]
fn documents_are_well_formed_whatever_names_are() {
    for name in NAMES {
        let document = svg(&figure(name)).unwrap();
        expect_well_formed(&document);
        assert!(begins_svg(&document) && !document.contains("<script"), "{document}");
    }
}

#[test]
fn panels_of_a_page_are_well_formed_and_have_its_colours_and_no_ids() {
    for name in NAMES {
        let figure = figure(name);
        for part in &figure.panels {
            let element = panel(&figure, part, 350, "plot", name).unwrap();
            expect_well_formed(&element);
            assert!(element.contains(&format!("aria-label=\"{}\"", escaped(name))), "{element}");
            for forbidden in ["<script", " id=", " style=", "=\"#"] {
                assert!(!element.contains(forbidden), "{forbidden}: {element}");
            }
        }
        expect_well_formed(&sample(&figure.panels[0].series[0]));
    }
}

#[test]
fn marks_of_one_kind_are_one_path() {
    let mut figure = figure("many");
    let points = (0..10_000).map(|n| [f64::from(n % 100), f64::from(n / 100)]).collect();
    figure.panels[0].series = vec![Series::points("", Colour::Grey, Symbol::Dot, points)];
    let element = panel(&figure, &figure.panels[0], 350, "plot", "").unwrap();
    assert_eq!(element.matches("stroke-linecap").count(), 1);
    assert!(element.len() < 160_000, "{}", element.len());
}

#[test]
fn marks_beyond_the_axes_are_not_drawn() {
    let mut figure = figure("cut");
    figure.panels[0].y = Axis::within("y", "", [0.0, 1.0]);
    figure.panels[0].series = vec![
        Series::points("", Colour::Green, Symbol::Triangle, vec![[0.0, 0.5], [1.0, 7.0]]),
        Series::line("", Colour::Blue, vec![[0.0, 5.0], [1.0, 6.0]]),
        Series::band("", Colour::Sky, vec![[0.0, 5.0, 6.0], [1.0, 6.0, 7.0]]),
    ];
    let element = panel(&figure, &figure.panels[0], 350, "plot", "").unwrap();
    assert_eq!(element.matches("class=\"f-c3\"").count(), 1);
    assert!(!element.contains("l-c1") && !element.contains("f-c5"), "{element}");
}

/// The strings that a page shows, in order.
fn shown(document: &[u8]) -> String {
    let text = document.iter().map(|&byte| char::from(byte)).collect::<String>();
    text.lines().filter(|line| line.ends_with("Tj")).map(|line| line.to_owned() + "\n").collect()
}

#[test]
fn pdfs_have_the_figures_words_as_text() {
    let document = pdf(&figure("größe (物)")).unwrap();
    assert!(begins_pdf(&String::from_utf8_lossy(&document)) && document.ends_with(b"%%EOF"));
    let words = shown(&document);
    for text in ["(x (cm))", "(clouds)", "(other)"] {
        assert!(words.contains(text), "{text}: {words}");
    }
    assert!(words.contains("<6772F6DF652028BF29>"), "{words}");
    assert_eq!(pdf(&figure("a")).unwrap(), pdf(&figure("a")).unwrap());
    for name in NAMES {
        assert!(begins_pdf(&String::from_utf8_lossy(&pdf(&figure(name)).unwrap())));
    }
}

#[test]
fn figures_without_marks_or_panels_are_documents_too() {
    let mut figure = figure("empty");
    figure.panels.truncate(1);
    figure.panels[0].series.clear();
    expect_well_formed(&svg(&figure).unwrap());
    figure.panels.clear();
    expect_well_formed(&svg(&figure).unwrap());
    assert!(!pdf(&figure).unwrap().is_empty());
}

#[test]
fn the_legend_names_everything_once_and_wraps() {
    let figure = figure("a");
    assert_eq!(legend(&figure).iter().map(|entry| entry.name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
    let entries: Vec<&Series> = legend(&figure).into_iter().cycle().take(40).collect();
    let lines = legend_lines(&entries);
    assert!(lines.len() > 1);
    assert_eq!(lines.iter().map(Vec::len).sum::<usize>(), 40);
}
