//! The meaning of `[dataset]`: paths, layout, splits and synthetic clouds that fit together.

use std::path::Path;

use descriptor::synth::SynthSettings;

use super::checks::checked_seed;
use super::forms::{RawLists, RawSeeded, RawSplitTable, RawSplitWord, RawSplits};
use super::paths::{self, Lookup};
use super::raw_dataset::{RawDataset, RawLayout, RawSynthetic, RawUnit};
use crate::dataset::{
    DatasetSettings, Layout, PatternError, SPLITS, SeededSplit, SplitRule, SyntheticSettings,
};
use artefact::sections::Fault;
use artefact::text::number;

/// Checks `[dataset]`. Paths are expanded and joined, not looked at. `validates`: whether the search needs the validation
/// split.
pub(super) fn dataset(
    raw: RawDataset,
    validates: bool,
    folder: &Path,
    lookup: Lookup<'_>,
) -> Result<DatasetSettings, Fault> {
    let root = paths::resolve("dataset.root", &raw.root, folder, lookup)?;
    let layout = layout(raw.layout, raw.manifest.as_deref(), raw.pattern.as_deref(), &root, lookup)?;
    let splits = match raw.splits {
        Some(RawSplits::Word(RawSplitWord::Manifest)) => SplitRule::Manifest,
        Some(RawSplits::Table(table)) => split_table(*table, &layout, validates, &root, lookup)?,
        None if matches!(layout, Layout::Manifest { .. }) => SplitRule::Manifest,
        None => split_table(RawSplitTable::default(), &layout, validates, &root, lookup)?,
    };
    if splits == SplitRule::Manifest && !matches!(layout, Layout::Manifest { .. }) {
        return Err(Fault::new(
            "dataset.splits",
            "there is no manifest in this layout, got \"manifest\"",
            "write `layout = \"manifest\"`, or name lists or a seeded draw in [dataset.splits]",
        ));
    }
    let synthetic =
        raw.synthetic.map(|synthetic| checked_synthetic(&synthetic, &layout, raw.unit)).transpose()?;
    Ok(DatasetSettings { root, layout, splits, skip_unreadable: raw.skip_unreadable, synthetic })
}

/// How labels are found, and the one key that the layout needs.
fn layout(
    name: RawLayout,
    manifest: Option<&str>,
    pattern: Option<&str>,
    root: &Path,
    lookup: Lookup<'_>,
) -> Result<Layout, Fault> {
    let missing = |key: &str, layout: &str, example: &str| {
        let what = format!("required key missing for layout = \"{layout}\", got none");
        Err(Fault::new(format!("dataset.{key}"), what, format!("add `{key} = \"{example}\"`")))
    };
    let found = match (name, manifest, pattern) {
        (RawLayout::Uw, ..) => Layout::Uw,
        (RawLayout::Folders, ..) => Layout::Folders,
        (RawLayout::Bop, ..) => Layout::Bop,
        (RawLayout::Manifest, Some(file), _) => {
            Layout::Manifest { file: paths::resolve("dataset.manifest", file, root, lookup)? }
        }
        (RawLayout::Manifest, None, _) => return missing("manifest", "manifest", "clouds.csv"),
        (RawLayout::Pattern, _, Some(text)) => {
            Layout::Pattern(text.parse().map_err(|error: PatternError| {
                Fault::from_message("dataset.", &format!("pattern: {error}"))
            })?)
        }
        (RawLayout::Pattern, _, None) => {
            return missing("pattern", "pattern", "{category}_{instance}_{sequence}_{any}.pcd");
        }
    };
    for (key, got, is_used) in [
        ("manifest", manifest, matches!(found, Layout::Manifest { .. })),
        ("pattern", pattern, matches!(found, Layout::Pattern(_))),
    ] {
        if let Some(got) = got.filter(|_| !is_used) {
            return Err(Fault::new(
                format!("dataset.{key}"),
                format!("not used by this layout, got {got:?}"),
                format!("remove it, or write `layout = \"{key}\"`"),
            ));
        }
    }
    Ok(found)
}

fn split_table(
    raw: RawSplitTable,
    layout: &Layout,
    validates: bool,
    root: &Path,
    lookup: Lookup<'_>,
) -> Result<SplitRule, Fault> {
    let RawSplitTable { train1, train2, validation, test, seeded } = raw;
    let lists = [train1, train2, validation, test];
    if let Some(seeded) = seeded {
        for (key, list) in SPLITS.iter().zip(lists) {
            if let Some(list) = list {
                return Err(Fault::new(
                    format!("dataset.splits.{key}"),
                    format!("a list beside a seeded draw, got {list}"),
                    "remove the list, or remove `seeded`",
                ));
            }
        }
        return seeded_split(seeded, layout, validates).map(SplitRule::Seeded);
    }
    listed_split(lists, validates, root, lookup)
}

fn listed_split(
    lists: [Option<RawLists>; 4],
    validates: bool,
    root: &Path,
    lookup: Lookup<'_>,
) -> Result<SplitRule, Fault> {
    let mut paths = [const { Vec::new() }; 4];
    for ((split, lists), paths) in SPLITS.into_iter().zip(lists).zip(&mut paths) {
        let place = format!("dataset.splits.{split}");
        let lists = lists.map_or_else(|| vec![format!("{split}.txt")], RawLists::paths);
        if lists.is_empty() && split != "validation" {
            return Err(Fault::new(place, "a split without lists, got []", "name a list"));
        }
        if lists.is_empty() && validates {
            return Err(Fault::new(
                place,
                "the search needs validation clouds, got []",
                "name a list, or set stop.validation_patience = \"off\" and search.winner = \"fitness\"",
            ));
        }
        *paths =
            lists.iter().map(|list| paths::resolve(&place, list, root, lookup)).collect::<Result<_, _>>()?;
    }
    Ok(SplitRule::Lists(paths))
}

fn seeded_split(raw: RawSeeded, layout: &Layout, validates: bool) -> Result<SeededSplit, Fault> {
    const WHOLE: u32 = 1_000_000;
    let place = |key: &str| format!("dataset.splits.seeded.{key}");
    // In whole millionths, so that shares add up exactly.
    let share = |key: &str, value: f64| {
        let parts = (value * f64::from(WHOLE)).round();
        if !(0.0..=f64::from(WHOLE)).contains(&parts) || (value - parts / f64::from(WHOLE)).abs() > 1e-9 {
            return Err(Fault::new(
                place(key),
                format!("not between 0 and 1 with at most six decimals, got {}", number(value)),
                "write a share of all clouds, such as 0.25",
            ));
        }
        Ok(parts as u32)
    };
    let needed = [
        ("train1", raw.train1, true),
        ("train2", raw.train2, true),
        ("validation", raw.validation, validates),
    ];
    let mut parts = [0; 4];
    for (part, (key, value, needed)) in parts.iter_mut().zip(needed) {
        *part = share(key, value)?;
        if needed && *part == 0 {
            return Err(Fault::new(
                place(key),
                "a split without clouds, got 0",
                "write a share above 0 (validation may be 0 with stop.validation_patience = \"off\" and search.winner = \"fitness\")",
            ));
        }
    }
    let drawn: u32 = parts.iter().sum();
    parts[3] = match raw.test {
        Some(test) => share("test", test)?,
        None if raw.test_sequences.is_empty() => WHOLE.saturating_sub(drawn),
        None => 0,
    };
    if drawn + parts[3] > WHOLE {
        return Err(Fault::new(
            "dataset.splits.seeded",
            format!("shares add up to more than 1, got {}", f64::from(drawn + parts[3]) / f64::from(WHOLE)),
            "lower train1, train2, validation or test",
        ));
    }
    if parts[3] > 0 && !raw.test_sequences.is_empty() {
        return Err(Fault::new(
            place("test"),
            format!("a share beside test_sequences, got {}", f64::from(parts[3]) / f64::from(WHOLE)),
            "remove it: the test split is exactly the clouds of these sequences",
        ));
    }
    if parts[3] == 0 && raw.test_sequences.is_empty() {
        return Err(Fault::new(
            place("test"),
            "a split without clouds, got 0",
            "write a share above 0 and lower the others, or name test_sequences",
        ));
    }
    let without = match layout {
        Layout::Folders => Some("layout \"folders\" has no sequences"),
        Layout::Pattern(pattern) if !pattern.has_sequences() => Some("the pattern has no {sequence}"),
        Layout::Uw | Layout::Bop | Layout::Manifest { .. } | Layout::Pattern(_) => None,
    };
    if let Some(without) = without.filter(|_| !raw.test_sequences.is_empty()) {
        return Err(Fault::new(
            place("test_sequences"),
            format!("{without}, got {:?}", raw.test_sequences),
            "remove them, or use layout \"uw\", \"bop\" or \"manifest\", or a pattern with {sequence}",
        ));
    }
    let mut test_sequences = raw.test_sequences;
    test_sequences.sort();
    test_sequences.dedup();
    Ok(SeededSplit {
        seed: checked_seed(&place("seed"), raw.seed)?,
        shares: parts.map(|part| f64::from(part) / f64::from(WHOLE)),
        stratified: raw.stratified,
        test_sequences,
    })
}

fn checked_synthetic(raw: &RawSynthetic, layout: &Layout, unit: RawUnit) -> Result<SyntheticSettings, Fault> {
    if *layout != Layout::Uw {
        return Err(Fault::new(
            "dataset.layout",
            "synthetic clouds are laid out as \"uw\", got another layout",
            "write `layout = \"uw\"` or remove [dataset.synthetic]",
        ));
    }
    if matches!(unit, RawUnit::Mm) {
        return Err(Fault::new(
            "dataset.unit",
            "synthetic clouds are in metres, got \"mm\"",
            "write `unit = \"m\"` or remove [dataset.synthetic]",
        ));
    }
    let seed = checked_seed("dataset.synthetic.seed", raw.seed)?;
    SynthSettings::new(raw.objects, raw.views, seed)
        .map_err(|error| Fault::from_message("dataset.synthetic.", &error.to_string()))?;
    Ok(SyntheticSettings { objects: raw.objects, views: raw.views, seed })
}
