//! Which clouds a data set lists, as a table of text that runs keep, and in which of them two data sets differ.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use proto::Digest;

use super::SPLITS;

/// First line of the table.
const HEADER: &str = "digest\tsplit\tcategory\tinstance\tpath";
/// What its header ends with if clouds have sets.
const SET_COLUMN: &str = "\tset";
/// What stands for the digest of a file that cannot be read.
const UNREADABLE: &str = "-";
/// Clouds of one kind of difference that are named; the others are only counted.
const NAMED: usize = 5;

/// A listed cloud, usable or not.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CloudRecord {
    /// Position of its split in [`SPLITS`].
    pub split: usize,
    /// Its category.
    pub category: String,
    /// Its instance.
    pub instance: String,
    /// Relative to the data root, with `/`.
    pub path: String,
    /// Its set, if there are sets.
    pub set: Option<String>,
    /// BLAKE3 of the file's bytes; `None` if they cannot be read.
    pub digest: Option<[u8; 32]>,
}

/// The data digest: one altered bit, label or line of a list changes it.
pub fn data_digest(clouds: &[CloudRecord]) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new_derive_key("descry data set v1");
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    for cloud in clouds {
        part(SPLITS[cloud.split].as_bytes());
        part(cloud.category.as_bytes());
        part(cloud.instance.as_bytes());
        match &cloud.digest {
            Some(digest) => {
                part(b"bytes");
                part(digest);
            }
            None => {
                part(b"unreadable");
                part(cloud.path.as_bytes());
            }
        }
        if let Some(set) = &cloud.set {
            part(b"set");
            part(set.as_bytes());
        }
    }
    *hasher.finalize().as_bytes()
}

/// The clouds as a table, a line each, in their order. No field has a control character: lists and manifests with one
/// are refused.
pub fn to_text(clouds: &[CloudRecord]) -> String {
    let has_sets = clouds.iter().any(|cloud| cloud.set.is_some());
    let mut text = format!("{HEADER}{}\n", if has_sets { SET_COLUMN } else { "" });
    for CloudRecord { split, category, instance, path, set, digest } in clouds {
        let digest = digest.map_or_else(|| UNREADABLE.to_owned(), |digest| Digest(digest).to_string());
        // Writing to a String cannot fail.
        let _ = write!(text, "{digest}\t{}\t{category}\t{instance}\t{path}", SPLITS[*split]);
        if has_sets {
            let _ = write!(text, "\t{}", set.as_deref().unwrap_or_default());
        }
        text.push('\n');
    }
    text
}

/// The inverse of [`to_text`]; `None` if the text is no such table.
pub fn from_text(text: &str) -> Option<Vec<CloudRecord>> {
    let mut lines = text.lines();
    let has_sets = match lines.next()?.strip_prefix(HEADER)? {
        "" => false,
        SET_COLUMN => true,
        _ => return None,
    };
    lines.map(|line| from_line(line, has_sets)).collect()
}

fn from_line(line: &str, has_sets: bool) -> Option<CloudRecord> {
    let (line, set) = if has_sets { line.rsplit_once('\t')? } else { (line, "") };
    let fields: Vec<&str> = line.split('\t').collect();
    let [digest, split, category, instance, path] = fields[..] else { return None };
    Some(CloudRecord {
        split: SPLITS.iter().position(|name| *name == split)?,
        category: category.to_owned(),
        instance: instance.to_owned(),
        path: path.to_owned(),
        set: (!set.is_empty()).then(|| set.to_owned()),
        digest: match digest {
            UNREADABLE => None,
            digest => Some(*blake3::Hash::from_hex(digest).ok()?.as_bytes()),
        },
    })
}

/// In what the clouds of now differ from those of then, a line for each kind of difference.
pub fn difference(then: &[CloudRecord], now: &[CloudRecord]) -> Vec<String> {
    let by_path = |clouds: &[CloudRecord]| -> BTreeMap<String, CloudRecord> {
        clouds.iter().map(|cloud| (cloud.path.clone(), cloud.clone())).collect()
    };
    let (before, after) = (by_path(then), by_path(now));
    let (mut changed, mut moved, mut renamed, mut regrouped) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (path, old) in &before {
        let Some(new) = after.get(path) else { continue };
        if old.digest != new.digest {
            changed.push(path.clone());
        }
        if old.split != new.split {
            moved.push(format!("{path} ({}, was {})", SPLITS[new.split], SPLITS[old.split]));
        }
        if (&old.category, &old.instance) != (&new.category, &new.instance) {
            let CloudRecord { category, instance, .. } = old;
            renamed.push(format!("{path} ({}/{}, was {category}/{instance})", new.category, new.instance));
        }
        if old.set != new.set {
            let [set, was] = [new, old].map(|cloud| cloud.set.as_deref().unwrap_or("none"));
            regrouped.push(format!("{path} ({set}, was {was})"));
        }
    }
    let missing = |from: &BTreeMap<String, CloudRecord>, other: &BTreeMap<String, CloudRecord>| {
        from.keys().filter(|path| !other.contains_key(*path)).cloned().collect::<Vec<_>>()
    };
    let kinds = [
        ("other bytes", changed),
        ("no longer listed", missing(&before, &after)),
        ("listed anew", missing(&after, &before)),
        ("in another split", moved),
        ("of other labels", renamed),
        ("of another set", regrouped),
    ];
    let lines = kinds.into_iter().filter(|(_, clouds)| !clouds.is_empty()).map(|(kind, clouds)| {
        let named = clouds[..clouds.len().min(NAMED)].join(", ");
        let more = if clouds.len() > NAMED { ", …" } else { "" };
        format!("{kind}: {} of {} clouds: {named}{more}", clouds.len(), before.len())
    });
    let mut lines: Vec<String> = lines.collect();
    if lines.is_empty() && then != now {
        lines.push("the same clouds, listed in another order".to_owned());
    }
    lines
}

#[cfg(test)]
mod tests {
    use expect_test::expect;
    use proptest::prelude::*;

    use super::*;

    fn cloud(split: usize, instance: &str, number: u8) -> CloudRecord {
        CloudRecord {
            split,
            category: instance.split('_').next().unwrap_or_default().to_owned(),
            instance: instance.to_owned(),
            path: format!("{instance}_{number}.pcd"),
            set: None,
            digest: Some([number; 32]),
        }
    }

    fn clouds() -> impl Strategy<Value = Vec<CloudRecord>> {
        let field = "[a-z /é_-]{0,8}";
        let set = proptest::option::of("[a-z /é_-]{1,8}");
        let cloud = (0..4_usize, field, field, field, set, any::<Option<[u8; 32]>>()).prop_map(
            |(split, category, instance, path, set, digest)| CloudRecord {
                split,
                category,
                instance,
                path,
                set,
                digest,
            },
        );
        prop::collection::vec(cloud, 0..8)
    }

    proptest! {
        #[test]
        fn the_table_gives_the_clouds_back(clouds in clouds()) {
            prop_assert_eq!(from_text(&to_text(&clouds)), Some(clouds));
        }

        #[test]
        fn what_is_no_table_is_told_from_one(text in "\\PC{0,200}") {
            prop_assert_eq!(from_text(&text), None);
            prop_assert_eq!(from_text(&format!("{HEADER}\n{text}\n")), None);
        }

        #[test]
        fn only_equal_clouds_do_not_differ(a in clouds(), b in clouds()) {
            prop_assert!(difference(&a, &a).is_empty());
            prop_assert_eq!(difference(&a, &b).is_empty(), a == b);
        }
    }

    #[test]
    fn each_kind_of_difference_names_its_clouds() {
        let then: Vec<CloudRecord> = (0..8).map(|number| cloud(0, "cup_1", number)).collect();
        let mut now = then.clone();
        now[0].digest = Some([99; 32]);
        now[1].split = 3;
        now[2].instance = "cup_2".to_owned();
        now.remove(7);
        now.push(cloud(1, "ball_1", 1));
        expect![[r#"
            other bytes: 1 of 8 clouds: cup_1_0.pcd
            no longer listed: 1 of 8 clouds: cup_1_7.pcd
            listed anew: 1 of 8 clouds: ball_1_1.pcd
            in another split: 1 of 8 clouds: cup_1_1.pcd (test, was train1)
            of other labels: 1 of 8 clouds: cup_1_2.pcd (cup/cup_2, was cup/cup_1)"#]]
        .assert_eq(&difference(&then, &now).join("\n"));
        expect!["no longer listed: 8 of 8 clouds: cup_1_0.pcd, cup_1_1.pcd, cup_1_2.pcd, cup_1_3.pcd, cup_1_4.pcd, …"]
            .assert_eq(&difference(&then, &[]).join("\n"));
        let turned: Vec<CloudRecord> = then.iter().rev().cloned().collect();
        expect!["the same clouds, listed in another order"].assert_eq(&difference(&then, &turned).join("\n"));
    }
}
