//! No file imports another in a circle, within any crate: read from the `use` items and paths of every source.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::experiments::repository;

/// A module by the names that lead to it from the root of its crate.
type Module = Vec<String>;

/// A path as a source has it, and whether a `pub use` gives it on.
struct Import {
    path: Vec<String>,
    is_public: bool,
}

/// Identifiers, `::` and single characters, without comments, strings and lifetimes.
pub fn tokens(text: &str) -> Vec<String> {
    let chars: Vec<char> = text.chars().collect();
    let at = |index: usize| chars.get(index).copied().unwrap_or('\0');
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let (mut tokens, mut i) = (Vec::new(), 0);
    while i < chars.len() {
        let c = chars[i];
        if c == '/' && at(i + 1) == '/' {
            while i < chars.len() && chars[i] != '\n' {
                i += 1;
            }
        } else if c == 'r' && (at(i + 1) == '"' || at(i + 1) == '#' && (at(i + 2) == '"' || at(i + 2) == '#'))
        {
            let hashes = chars[i + 1..].iter().take_while(|&&c| c == '#').count();
            i += hashes + 2;
            let closes = |i: usize| at(i) == '"' && (1..=hashes).all(|k| at(i + k) == '#');
            while i < chars.len() && !closes(i) {
                i += 1;
            }
            i += hashes + 1;
        } else if c == '"' {
            i += 1;
            while i < chars.len() && chars[i] != '"' {
                i += if chars[i] == '\\' { 2 } else { 1 };
            }
            i += 1;
        } else if c == '\'' {
            // A character ends with a quote, a lifetime does not.
            let end = if at(i + 1) == '\\' { (i + 3..i + 12).find(|&k| at(k) == '\'') } else { Some(i + 2) };
            i = end.filter(|&k| at(k) == '\'').map_or(i + 1, |k| k + 1);
        } else if is_word(c) {
            let end = (i..chars.len()).find(|&k| !is_word(chars[k])).unwrap_or(chars.len());
            tokens.push(chars[i..end].iter().collect());
            i = end;
        } else if c == ':' && at(i + 1) == ':' {
            tokens.push("::".to_owned());
            i += 2;
        } else {
            if !c.is_whitespace() {
                tokens.push(c.to_string());
            }
            i += 1;
        }
    }
    tokens
}

/// Leaves out every item, or block, that is compiled for tests only.
pub fn without_tests(tokens: &[String]) -> Vec<String> {
    let is = |index: usize, text: &str| tokens.get(index).is_some_and(|token| token == text);
    let (mut kept, mut i) = (Vec::new(), 0);
    while i < tokens.len() {
        let is_attribute = is(i, "#") && is(i + 1, "[") && is(i + 2, "cfg") && is(i + 3, "(");
        if !(is_attribute && is(i + 4, "test") && is(i + 5, ")")) {
            kept.push(tokens[i].clone());
            i += 1;
            continue;
        }
        let mut depth = 0;
        i += 7;
        while i < tokens.len() {
            match tokens[i].as_str() {
                "{" => depth += 1,
                "}" => depth -= 1,
                _ => {}
            }
            i += 1;
            if depth == 0 && (is(i - 1, "}") || is(i - 1, ";")) {
                break;
            }
        }
    }
    kept
}

/// The paths of a `use` item, without aliases: `a::{b, c::d as e}` has two.
fn use_tree(prefix: &[String], tokens: &[String], found: &mut Vec<Vec<String>>) {
    let mut path = prefix.to_vec();
    let mut i = 0;
    while i < tokens.len() {
        match tokens[i].as_str() {
            "::" => {}
            "as" => break,
            "{" => {
                let (mut depth, mut begin) = (0, i + 1);
                for end in i..tokens.len() {
                    match tokens[end].as_str() {
                        "{" => depth += 1,
                        "}" => depth -= 1,
                        _ => {}
                    }
                    if depth == 0 || depth == 1 && tokens[end] == "," {
                        use_tree(&path, &tokens[begin..end], found);
                        begin = end + 1;
                    }
                }
                return;
            }
            name => path.push(name.to_owned()),
        }
        i += 1;
    }
    if path.len() > prefix.len() {
        found.push(path);
    }
}

fn imports(text: &str) -> Vec<Import> {
    let tokens = without_tests(&tokens(text));
    let is_inner = |name: &str| ["crate", "super", "self"].contains(&name);
    let (mut imports, mut i) = (Vec::new(), 0);
    while i < tokens.len() {
        let before = i.checked_sub(1).map(|before| tokens[before].as_str());
        if tokens[i] == "use" {
            let end = (i..tokens.len()).find(|&k| tokens[k] == ";").unwrap_or(tokens.len());
            let is_public = matches!(before, Some("pub" | ")"));
            let mut paths = Vec::new();
            use_tree(&[], &tokens[i + 1..end], &mut paths);
            for mut path in paths {
                if is_public && !is_inner(&path[0]) {
                    path.insert(0, "self".to_owned());
                }
                if is_inner(&path[0]) {
                    imports.push(Import { path, is_public });
                }
            }
            i = end;
        } else if is_inner(&tokens[i]) && before != Some("::") && before != Some("(") {
            let mut path = vec![tokens[i].clone()];
            while tokens.get(i + 1).is_some_and(|token| token == "::")
                && tokens.get(i + 2).is_some_and(|token| token.starts_with(|c: char| c.is_alphabetic()))
            {
                path.push(tokens[i + 2].clone());
                i += 2;
            }
            if path.len() > 1 && path[0] != "self" {
                imports.push(Import { path, is_public: false });
            }
        }
        i += 1;
    }
    imports
}

/// The sources of a crate by module, tests aside.
fn modules(folder: &Path, at: &Module, found: &mut BTreeMap<Module, String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let inside = |name: &str| at.iter().cloned().chain([name.to_owned()]).collect::<Module>();
        if path.is_dir() && name != "tests" {
            modules(&path, &inside(&name), found);
        } else if path.extension().is_some_and(|extension| extension == "rs") && name != "tests" {
            let module =
                if ["mod", "lib", "main"].contains(&name.as_str()) { at.clone() } else { inside(&name) };
            found.entry(module).or_default().push_str(&fs::read_to_string(&path).unwrap());
        }
    }
}

fn absolute(module: &Module, path: &[String]) -> Module {
    let mut at = module.clone();
    let mut rest = path;
    while let [first, tail @ ..] = rest {
        match first.as_str() {
            "crate" => at.clear(),
            "super" => drop(at.pop()),
            "self" => {}
            _ => break,
        }
        rest = tail;
    }
    at.extend(rest.iter().cloned());
    at
}

/// What a module gives on, by name.
type Exports = BTreeMap<Module, BTreeMap<String, Module>>;

/// The module in which what a path names is written.
fn target(path: Module, modules: &BTreeMap<Module, String>, exports: &Exports, hops: u32) -> Option<Module> {
    let length = (0..=path.len()).rev().find(|&length| modules.contains_key(&path[..length]))?;
    let module = path[..length].to_vec();
    let exported = path.get(length).and_then(|name| exports.get(&module)?.get(name));
    match exported {
        Some(further) if hops > 0 => {
            let further = further.iter().chain(&path[length + 1..]).cloned().collect();
            target(further, modules, exports, hops - 1)
        }
        _ => Some(module),
    }
}

/// The files of a crate that import each other in a circle, one list a circle.
fn circles(modules: &BTreeMap<Module, String>) -> Vec<BTreeSet<String>> {
    let imports: BTreeMap<&Module, Vec<Import>> =
        modules.iter().map(|(module, text)| (module, imports(text))).collect();
    let mut exports = Exports::new();
    for (module, imports) in &imports {
        for Import { path, .. } in imports.iter().filter(|import| import.is_public) {
            let name = path.last().unwrap().clone();
            exports.entry((*module).clone()).or_default().insert(name, absolute(module, path));
        }
    }
    let mut reached: BTreeMap<&Module, BTreeSet<Module>> = BTreeMap::new();
    for (module, imports) in &imports {
        let direct = imports.iter().filter(|import| !import.is_public);
        let targets =
            direct.filter_map(|import| target(absolute(module, &import.path), modules, &exports, 6));
        let others = targets.filter(|target| target != *module && !target.is_empty());
        reached.insert(module, others.collect());
    }
    // Closed under "imports what it imports": small graphs need nothing better.
    loop {
        let mut grown = false;
        for module in modules.keys() {
            let further: BTreeSet<Module> =
                reached[module].iter().flat_map(|next| reached[next].iter().cloned()).collect();
            let own = reached.get_mut(module).unwrap();
            let before = own.len();
            own.extend(further);
            grown |= own.len() > before;
        }
        if !grown {
            break;
        }
    }
    let name = |module: &Module| if module.is_empty() { "root".to_owned() } else { module.join("::") };
    let together = |a: &Module, b: &Module| reached[a].contains(b) && reached[b].contains(a);
    let circle = |one: &Module| modules.keys().filter(|other| together(one, other)).map(name).collect();
    let all: BTreeSet<BTreeSet<String>> = modules.keys().map(circle).collect();
    all.into_iter().filter(|circle| circle.len() > 1).collect()
}

fn crate_of(files: &[(&str, &str)]) -> BTreeMap<Module, String> {
    let module = |name: &str| name.split("::").filter(|part| !part.is_empty()).map(str::to_owned).collect();
    files.iter().map(|(name, text)| (module(name), (*text).to_owned())).collect()
}

#[test]
fn circles_are_found_through_uses_paths_and_re_exports_and_nowhere_else() {
    let found = |files: &[(&str, &str)]| circles(&crate_of(files));
    let both = || vec![BTreeSet::from(["a".to_owned(), "b".to_owned()])];
    assert_eq!(found(&[("", ""), ("a", "use crate::b::{X, y::Z};"), ("b", "use super::a::Y;")]), both());
    assert_eq!(
        found(&[("a", "fn f() { crate::b::g() }"), ("b", "use crate::{a::f, c};"), ("c", "")]),
        both()
    );
    // By way of what the parent gives on.
    let parent = ("p", "mod a;\nmod b;\npub use a::A;\npub use b::B;");
    let children = [parent, ("p::a", "use super::B;"), ("p::b", "use crate::p::A;")];
    assert_eq!(found(&children), [BTreeSet::from(["p::a".to_owned(), "p::b".to_owned()])]);
    for innocent in [
        "#[cfg(test)]\nmod tests { use crate::b::Y; }",
        "#[cfg(test)]\nuse crate::b::Y;",
        "// use crate::b::Y;",
        "const TEXT: &str = \"use crate::b::Y;\";",
        "const TEXT: &str = r#\"use crate::b::Y;\"#; const C: char = '\"'; fn f<'a>() {}",
        "pub use crate::b::Y;",
    ] {
        assert!(found(&[("a", innocent), ("b", "use crate::a::X;")]).is_empty(), "{innocent}");
    }
}

#[test]
fn no_file_imports_another_in_a_circle() {
    let mut found = Vec::new();
    for member in crate::repository::members() {
        let folder = repository().join(&member).join("src");
        let mut sources = BTreeMap::new();
        modules(&folder, &Module::new(), &mut sources);
        assert!(!sources.is_empty(), "{member}: no sources");
        found.extend(circles(&sources).into_iter().map(|circle| format!("{member}: {circle:?}")));
    }
    assert!(found.is_empty(), "files that import each other in a circle:\n{}", found.join("\n"));
}
