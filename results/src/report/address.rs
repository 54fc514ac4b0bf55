//! Addresses from one file to another, as links of a page have them.

use std::fs;
use std::path::{Component, Path, PathBuf};

/// The address of `target` in the page `page`; `None` if there is no way from one to the other.
pub(crate) fn address(page: &Path, target: &Path) -> Option<String> {
    let (from, to) = (real(page.parent()?)?, real(target)?);
    let (from, to): (Vec<_>, Vec<_>) = (from.components().collect(), to.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    // Nothing is shared by two drives of Windows.
    if shared == 0 {
        return None;
    }
    let mut address = "../".repeat(from.len() - shared);
    if address.is_empty() {
        address.push_str("./"); // a folder's name before a colon would be a scheme
    }
    let mut parts = Vec::new();
    for component in &to[shared..] {
        let Component::Normal(name) = component else { return None };
        parts.push(encoded(name.to_str()?));
    }
    Some(address + &parts.join("/"))
}

/// A path without links, as far as it is there.
fn real(path: &Path) -> Option<PathBuf> {
    let path = std::path::absolute(path).ok()?;
    let there = path.ancestors().find_map(|there| Some((there, fs::canonicalize(there).ok()?)));
    let (there, real) = there?;
    Some(real.join(path.strip_prefix(there).ok()?))
}

fn encoded(name: &str) -> String {
    let byte = |byte: u8| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'~' => char::from(byte).to_string(),
        byte => format!("%{byte:02X}"),
    };
    name.bytes().map(byte).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_lead_from_the_page_to_the_file() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = |name: &str| folder.path().join(name);
        let of = |page: &str, target: &str| address(&path(page), &path(target)).unwrap();
        assert_eq!(of("sweep/report/report.html", "sweep/ga/report/report.html"), "../ga/report/report.html");
        assert_eq!(of("all.html", "sweep/a/report.html"), "./sweep/a/report.html");
        assert_eq!(of("all.html", "javascript:alert(1)/r.html"), "./javascript%3Aalert%281%29/r.html");
        assert_eq!(of("a/r.html", "größe & \"b\"/r.html"), "../gr%C3%B6%C3%9Fe%20%26%20%22b%22/r.html");
    }
}
