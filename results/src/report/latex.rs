//! The comparison as a table for LaTeX, as the paper's Table 1 has it.

use std::fmt::Write as _;

use super::data::Rows;
use super::figure::printable;
use crate::error::Error;

/// Name of the file.
pub(crate) const FILE: &str = "table1.tex";

/// How every such file begins.
const BEGINNING: &str = "% Made by descry: ";

/// Whether a text begins as every such file does.
pub(crate) fn begins_table(text: &str) -> bool {
    text.starts_with(BEGINNING)
}

/// A `tabular` without any package: errors and times of all descriptors, in the order of the comparison, which is the
/// paper's.
pub(crate) fn table1(comparison: &Rows) -> Result<String, Error> {
    let names = comparison.texts("descriptor")?;
    let [object, category] = ["object_error", "category_error"].map(|column| comparison.numbers(column));
    let (object, category, seconds) = (object?, category?, comparison.optional("seconds_total")?);
    // Without the times of all stages there may be those of some clouds.
    let of_cloud = comparison.optional("seconds_cloud")?;
    let is_measured = seconds.iter().any(Option::is_some);
    let (times, unit, of_what) = match is_measured {
        true => (seconds, "Time (s)", "seconds for queries and database"),
        false => {
            let milliseconds = of_cloud.into_iter().map(|seconds| Some(1000.0 * seconds?)).collect();
            (milliseconds, "Time a cloud (ms)", "milliseconds to describe a cloud")
        }
    };
    let mut out = format!(
        "{BEGINNING}errors on the test clouds in percent, {of_what} on one thread.\n\
         \\begin{{tabular}}{{lrrr}}\n\\hline\n\
         Descriptor & Object error (\\%) & Category error (\\%) & {unit} \\\\\n\\hline\n"
    );
    for (row, name) in names.iter().enumerate() {
        let time = times[row].map_or_else(|| "--".to_owned(), |time| format!("{time:.2}"));
        let (object, category) = (100.0 * object[row], 100.0 * category[row]);
        // Writing to a String cannot fail.
        let _ = writeln!(out, "{} & {object:.2} & {category:.2} & {time} \\\\", escaped(name));
    }
    out.push_str("\\hline\n\\end{tabular}\n");
    Ok(out)
}

/// Text as LaTeX shows it. Letters that not every set of fonts has, which are those beyond Latin 1 and of Icelandic, become
/// a sign that is seen.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in printable(text).chars() {
        match c {
            '\\' => out.push_str("\\textbackslash{}"),
            '{' | '}' | '$' | '&' | '#' | '%' | '_' => out.extend(['\\', c]),
            '^' => out.push_str("\\textasciicircum{}"),
            '~' => out.push_str("\\textasciitilde{}"),
            '<' => out.push_str("\\textless{}"),
            '>' => out.push_str("\\textgreater{}"),
            '|' => out.push_str("\\textbar{}"),
            '"' => out.push_str("''"),
            // Would be a command's argument at the beginning of a row.
            '[' | ']' | '*' => out.extend(['{', c, '}']),
            '`' => out.push_str("\\textasciigrave{}"),
            // Two would be one longer dash.
            '-' if out.ends_with('-') => out.push_str("{}-"),
            'Ð' | 'Þ' | 'ð' | 'þ' => out.push_str("\\textquestiondown{}"),
            c if c.is_ascii() || ('À'..='ÿ').contains(&c) => out.push(c),
            _ => out.push_str("\\textquestiondown{}"),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_letters_whatever_they_are() {
        assert_eq!(escaped("paper-l1"), "paper-l1");
        assert_eq!(escaped(r"\input{/etc/passwd}"), r"\textbackslash{}input\{/etc/passwd\}");
        assert_eq!(
            escaped("50% of a_b & c#1 ~^$"),
            r"50\% of a\_b \& c\#1 \textasciitilde{}\textasciicircum{}\$"
        );
        assert_eq!(escaped("größe 物\n"), r"größe \textquestiondown{}\textquestiondown{}");
        assert_eq!(escaped("a--b---c`"), r"a-{}-b-{}-{}-c\textasciigrave{}");
        assert_eq!(escaped("Þór ð"), r"\textquestiondown{}ór \textquestiondown{}");
        assert_eq!(escaped("*[<|\">]"), "{*}{[}\\textless{}\\textbar{}''\\textgreater{}{]}");
    }
}
