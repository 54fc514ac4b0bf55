//! Paths of an experiment file: environment variables expanded, relative to the file's folder.

use std::env::VarError;
use std::path::{Path, PathBuf};

use artefact::sections::Fault;

/// Where variables come from; [`std::env::var`] outside tests.
pub(super) type Lookup<'a> = &'a dyn Fn(&str) -> Result<String, VarError>;

/// Expands the path at key `place` and puts `folder` before it if it is relative.
pub(super) fn resolve(place: &str, text: &str, folder: &Path, lookup: Lookup<'_>) -> Result<PathBuf, Fault> {
    let expanded = expand(place, text, lookup)?;
    if expanded.is_empty() {
        return Err(Fault::new(
            place,
            format!("empty path, got {text:?}"),
            "name a file or folder, `.` for the folder of this file",
        ));
    }
    if expanded.chars().any(char::is_control) {
        return Err(Fault::new(
            place,
            format!("control character in a path, got {expanded:?}"),
            "remove it; in \"…\" a backslash starts an escape, in '…' it does not",
        ));
    }
    if expanded.contains("${") {
        // It would be expanded again when the resolved experiment is read.
        return Err(Fault::new(
            place,
            format!("`${{` in the value of a variable, got {expanded:?}"),
            "set the variable to a plain path",
        ));
    }
    if expanded == "~" || expanded.starts_with("~/") {
        return Err(Fault::new(
            place,
            format!("`~` is not expanded, got {expanded:?}"),
            format!("write \"${{HOME}}{}\"", &expanded[1..]),
        ));
    }
    Ok(folder.join(expanded))
}

/// Replaces `${NAME}` and `${NAME:-default}`; as in a shell, the default also stands for an empty variable.
fn expand(place: &str, text: &str, lookup: Lookup<'_>) -> Result<String, Fault> {
    let mut expanded = String::new();
    let mut rest = text;
    while let Some(start) = rest.find("${") {
        expanded.push_str(&rest[..start]);
        let body = &rest[start + 2..];
        let Some(end) = body.find('}') else {
            return Err(Fault::new(
                place,
                format!("`${{` without `}}`, got {text:?}"),
                "write ${NAME} or ${NAME:-default}",
            ));
        };
        let (name, default) = match body[..end].split_once(":-") {
            Some((name, default)) => (name, Some(default)),
            None => (&body[..end], None),
        };
        if default.is_some_and(|default| default.contains("${")) {
            return Err(Fault::new(
                place,
                format!("a variable inside a default, got {text:?}"),
                "write a plain default after `:-`",
            ));
        }
        if !is_variable_name(name) {
            return Err(Fault::new(
                place,
                format!("no variable name between `${{` and `}}`, got {name:?}"),
                "write ${NAME} or ${NAME:-default}, with a name of letters, digits and _",
            ));
        }
        match (lookup(name), default) {
            (Ok(value), Some(default)) if value.is_empty() => expanded.push_str(default),
            (Ok(value), _) => expanded.push_str(&value),
            (Err(VarError::NotPresent), Some(default)) => expanded.push_str(default),
            (Err(VarError::NotPresent), None) => {
                return Err(Fault::new(
                    place,
                    format!("environment variable not set, got ${{{name}}}"),
                    format!("set {name}, or write ${{{name}:-default}}"),
                ));
            }
            (Err(VarError::NotUnicode(value)), _) => {
                return Err(Fault::new(
                    place,
                    format!("environment variable {name} is not UTF-8, got {value:?}"),
                    format!("set {name} to a path in UTF-8"),
                ));
            }
        }
        rest = &body[end + 1..];
    }
    expanded.push_str(rest);
    Ok(expanded)
}

fn is_variable_name(name: &str) -> bool {
    !name.starts_with(|c: char| c.is_ascii_digit())
        && !name.is_empty()
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

#[cfg(test)]
mod tests {
    use std::ffi::OsString;

    use expect_test::{Expect, expect};

    use super::*;

    fn lookup(name: &str) -> Result<String, VarError> {
        match name {
            "DATA" => Ok("/data".into()),
            "SUB" => Ok("sub".into()),
            "TRICK" => Ok("${DATA}".into()),
            "EMPTY" => Ok(String::new()),
            "ODD" => Err(VarError::NotUnicode(OsString::from("?"))),
            _ => Err(VarError::NotPresent),
        }
    }

    #[test]
    fn variables_and_defaults_are_expanded_and_relative_paths_joined() {
        for (text, expected) in [
            ("clouds", "exp/clouds"),
            ("./clouds", "exp/./clouds"),
            ("../clouds", "exp/../clouds"),
            ("/clouds", "/clouds"),
            ("${DATA}", "/data"),
            ("${DATA}/${SUB}/a${SUB}b", "/data/sub/asubb"),
            ("${NONE:-../shared}/x", "exp/../shared/x"),
            ("${NONE:-}x", "exp/x"),
            ("${DATA:-other}", "/data"),
            ("${EMPTY:-other}", "exp/other"),
            ("a$b {c} $", "exp/a$b {c} $"),
            ("über/日", "exp/über/日"),
        ] {
            assert_eq!(
                resolve("dataset.root", text, Path::new("exp"), &lookup).unwrap(),
                Path::new(expected),
                "{text}"
            );
        }
    }

    #[test]
    fn bad_paths_are_refused_with_advice() {
        let check = |text: &str, expected: Expect| {
            let fault = resolve("dataset.root", text, Path::new("exp"), &lookup).unwrap_err();
            expected.assert_eq(&format!("{}: {}\n{}", fault.place, fault.what, fault.advice));
        };
        check(
            "${NONE}/x",
            expect![[r#"
            dataset.root: environment variable not set, got ${NONE}
            set NONE, or write ${NONE:-default}"#]],
        );
        check(
            "a/${NONE",
            expect![[r#"
            dataset.root: `${` without `}`, got "a/${NONE"
            write ${NAME} or ${NAME:-default}"#]],
        );
        check(
            "${}",
            expect![[r#"
            dataset.root: no variable name between `${` and `}`, got ""
            write ${NAME} or ${NAME:-default}, with a name of letters, digits and _"#]],
        );
        check(
            "${1A:-x}",
            expect![[r#"
            dataset.root: no variable name between `${` and `}`, got "1A"
            write ${NAME} or ${NAME:-default}, with a name of letters, digits and _"#]],
        );
        check(
            "${NONE:-${DATA}}",
            expect![[r#"
            dataset.root: a variable inside a default, got "${NONE:-${DATA}}"
            write a plain default after `:-`"#]],
        );
        check(
            "${ODD}",
            expect![[r#"
            dataset.root: environment variable ODD is not UTF-8, got "?"
            set ODD to a path in UTF-8"#]],
        );
        check(
            "",
            expect![[r#"
            dataset.root: empty path, got ""
            name a file or folder, `.` for the folder of this file"#]],
        );
        check(
            "${EMPTY}",
            expect![[r#"
            dataset.root: empty path, got "${EMPTY}"
            name a file or folder, `.` for the folder of this file"#]],
        );
        check(
            "a\u{0}b",
            expect![[r#"
            dataset.root: control character in a path, got "a\0b"
            remove it; in "…" a backslash starts an escape, in '…' it does not"#]],
        );
        check(
            "${TRICK}",
            expect![[r#"
            dataset.root: `${` in the value of a variable, got "${DATA}"
            set the variable to a plain path"#]],
        );
        check(
            "~/clouds",
            expect![[r#"
            dataset.root: `~` is not expanded, got "~/clouds"
            write "${HOME}/clouds""#]],
        );
    }
}
