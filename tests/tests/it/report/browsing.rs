//! Reports as a browser shows them: every figure drawn, nothing asked of elsewhere, and fit for a telephone.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use tempfile::TempDir;

use crate::browser;
use crate::process::{Finished, run};

pub(super) fn report(args: &[&str]) -> Finished {
    run("coordinator", [&["report"], args].concat())
}

/// The SVG files in a folder, by figure.
pub(super) fn figures(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut figures: Vec<String> =
        names.filter_map(|name| name.strip_suffix(".svg").map(str::to_owned)).collect();
    figures.sort();
    figures
}

/// Opens a report and sees to it that all its figures are drawn, that nothing is wrong and that nothing is asked of
/// another machine; gives the document.
#[track_caller]
pub(super) fn expect_drawn(page: &Path, expected: &[&str]) -> Option<String> {
    let html = fs::read_to_string(page).unwrap();
    assert!(html.len() <= LARGEST, "{}", html.len());
    for never in ["plotly", "unsafe-", " style=\"", "src=\"http"] {
        assert!(!html.contains(never), "{never}");
    }
    let folder = TempDir::new().unwrap();
    let opened = browser::open(folder.path(), page)?;
    assert_eq!(opened.console, Vec::<String>::new());
    let mut names: Vec<&str> = Vec::new();
    for part in opened.dom.split("<figure id=\"").skip(1) {
        let (part, _) = part.split_once("</figure>").unwrap();
        let (id, _) = part.split_once('"').unwrap();
        assert!(
            part.contains("class=\"plot") && part.contains("role=\"img\" aria-label=\""),
            "{id}: not drawn"
        );
        assert!(part.matches("<path class=\"").count() > 2, "{id}: no marks");
        names.push(id);
    }
    names.sort_unstable();
    let mut expected = expected.to_vec();
    expected.sort_unstable();
    assert_eq!(names, expected);
    expect_ids_once(&opened.dom);
    let narrow = on_a_telephone(folder.path(), &html)?;
    assert!(narrow.width <= 390, "{} pixels wide", narrow.width);

    // Each figure as a file, too: a browser shows none that is not well-formed.
    let folder_of = page.parent().unwrap();
    assert_eq!(figures(folder_of), expected);
    let images: String = expected
        .iter()
        .map(|name| {
            let file = folder_of.join(format!("{name}.svg"));
            format!("<img src=\"file://{}\" onerror=\"console.error('broken: {name}')\">\n", file.display())
        })
        .collect();
    let gallery = folder.path().join("gallery.html");
    fs::write(&gallery, images).unwrap();
    assert_eq!(browser::open(folder.path(), &gallery)?.console, Vec::<String>::new());
    Some(opened.dom)
}

/// Every anchor leads to one place.
#[track_caller]
pub(super) fn expect_ids_once(dom: &str) {
    let mut met = BTreeSet::new();
    for part in dom.split(" id=\"").skip(1) {
        let (id, _) = part.split_once('"').unwrap();
        assert!(met.insert(id), "{id} twice");
    }
}

/// A page in a window of 390 pixels.
pub(super) struct Narrow {
    /// Pixels that it takes.
    pub width: u32,
    /// Its canvases, and those in which a cloud is drawn.
    pub canvases: [usize; 2],
}

/// Lays a page out in a frame of 390 pixels, and has it draw everything as for paper.
#[track_caller]
pub(super) fn on_a_telephone(folder: &Path, html: &str) -> Option<Narrow> {
    // In a script: JSON is JavaScript, but for what would end the script.
    let text = serde_json::to_string(html).unwrap().replace('<', "\\u003c");
    let script = "const frame = document.createElement('iframe'); frame.width = 390; frame.height = 800; \
        frame.style.border = 0; frame.srcdoc = text; frame.onload = () => setTimeout(() => { \
        frame.contentWindow.dispatchEvent(new Event('beforeprint')); \
        const of = frame.contentDocument; const all = [...of.querySelectorAll('canvas')]; \
        document.body.dataset.found = [of.documentElement.scrollWidth, all.length, \
        all.filter((canvas) => canvas.dataset.drawn).length].join(' '); }, 500); document.body.append(frame);";
    let page = folder.join("telephone.html");
    fs::write(&page, format!("<!DOCTYPE html><body><script>const text = {text};\n{script}</script></body>"))
        .unwrap();
    let opened = browser::open(folder, &page)?;
    assert_eq!(opened.console, Vec::<String>::new());
    let (_, found) = opened.dom.split_once("data-found=\"").expect("the frame was loaded");
    let found: Vec<usize> =
        found.split('"').next().unwrap().split(' ').map(|number| number.parse().unwrap()).collect();
    Some(Narrow { width: u32::try_from(found[0]).unwrap(), canvases: [found[1], found[2]] })
}

/// Bytes that a page may have.
pub(super) const LARGEST: usize = 2_000_000;
