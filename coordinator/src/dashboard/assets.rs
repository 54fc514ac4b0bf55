//! The files of the page.

/// A file of the page: its path, its type, and its content.
pub type Asset = (&'static str, &'static str, &'static str);

const JS: &str = "text/javascript; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";

macro_rules! pages {
    ($kind:expr; $($name:literal),* $(,)?) => {
        [$((concat!("/", $name), $kind, include_str!(concat!("page/", $name)))),*]
    };
}

const SCRIPTS: &[Asset] = &pages![JS;
    "answers.js",
    "api.js",
    "axes.js",
    "brush.js",
    "channel-bars.js",
    "chart.js",
    "cloud-cache.js",
    "cloud-input.js",
    "command.js",
    "comparison.js",
    "confusion.js",
    "curves.js",
    "dom.js",
    "format.js",
    "front.js",
    "histogram.js",
    "lanes.js",
    "lineage.js",
    "looks.js",
    "main.js",
    "parallel.js",
    "ramp.js",
    "ranges.js",
    "regions.js",
    "run-header.js",
    "scatter.js",
    "state.js",
    "store.js",
    "stream.js",
    "table.js",
    "theme.js",
    "timeline-canvas.js",
    "triple.js",
    "view-answers.js",
    "view-control.js",
    "view-convergence.js",
    "view-descriptor.js",
    "view-fleet.js",
    "view-log.js",
    "view-overview.js",
    "view-population.js",
    "view-runs.js",
    "view-timeline.js",
    "winners.js",
    "wrong-list.js",
];

const STYLES: &[Asset] = &pages![CSS; "clouds.css", "style.css"];

/// The file at a path.
pub fn asset(path: &str) -> Option<Asset> {
    if path == "/" {
        return Some(("/", "text/html; charset=utf-8", include_str!("page/index.html")));
    }
    if path == "/viewer.js" {
        return Some(("/viewer.js", JS, results::CLOUD_VIEWER));
    }
    SCRIPTS.iter().chain(STYLES).find(|(name, ..)| *name == path).copied()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// A file that is not served would only be missed in a browser.
    #[test]
    fn every_file_of_the_page_is_served() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/dashboard/page");
        let names =
            std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let there: BTreeSet<String> =
            names.filter(|name| name != "index.html").map(|name| format!("/{name}")).collect();
        let served: BTreeSet<String> =
            SCRIPTS.iter().chain(STYLES).map(|(name, ..)| (*name).to_owned()).collect();
        assert_eq!(there, served);
        assert!(asset("/").is_some() && asset("/viewer.js").is_some());
        assert_eq!(asset("/../main.js"), None);
    }
}
