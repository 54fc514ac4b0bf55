//! The page: sections of text, tables and figures as one self-contained HTML document.

use std::borrow::Cow;
use std::fmt::Write as _;

use super::figure::{Figure, printable};
use super::plotly::panel_json;

const STYLE: &str = include_str!("style.css");

/// How every page begins, up to the nonce of its scripts.
const BEGINNING: &str = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
    <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'nonce-";

/// Whether a text begins as every page does.
pub(crate) fn begins_page(text: &str) -> bool {
    text.starts_with(BEGINNING)
}

/// Draws all plots; errors go to the browser's console.
const DRAW: &str = "for (const [id, plot] of plots) Plotly.newPlot(id, plot.data, plot.layout, \
    {displayModeBar: false, typesetMath: false, plotlyServerURL: ''});";

/// How to use the interactive plots; not printed.
const HINT: &str = "In a figure, drag to look closely, double-click to go back, and click a name in the legend to hide \
    or show it.";

/// Columns from which on a table is set smaller, so that it fits on a sheet.
const DENSE: usize = 9;

/// A table as text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TableBlock {
    /// What it shows.
    pub caption: String,
    /// Names of its columns; empty: it has no head.
    pub head: Vec<String>,
    /// Its cells.
    pub rows: Vec<Vec<String>>,
    /// How many columns, from the left, are text; the others are numbers.
    pub texts: usize,
}

/// A part of a section.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Item {
    /// A paragraph.
    Text(String),
    /// What is missing, and how to get it.
    Missing(String),
    /// A table.
    Table(TableBlock),
    /// A figure.
    Figure(Figure),
    /// Text that is folded away, line by line.
    Details {
        /// What it is.
        summary: String,
        /// The text.
        text: String,
    },
}

/// A section of the page.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Section {
    /// Its anchor.
    pub id: &'static str,
    /// Its heading.
    pub title: &'static str,
    /// Its parts.
    pub items: Vec<Item>,
}

/// The whole document.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Page {
    /// Its heading.
    pub title: String,
    /// What it is about.
    pub lead: String,
    /// Its sections.
    pub sections: Vec<Section>,
}

impl Page {
    /// All figures, in order.
    pub fn figures(&self) -> impl Iterator<Item = &Figure> {
        self.sections.iter().flat_map(|section| &section.items).filter_map(|item| match item {
            Item::Figure(figure) => Some(figure),
            _ => None,
        })
    }

    /// The document. Equal pages give equal bytes.
    pub fn html(&self) -> String {
        let body = self.body();
        let plots = self.plots();
        // Only scripts that carry it run: not those that a name might smuggle in.
        let nonce = blake3::hash(format!("{body}{plots}").as_bytes()).to_hex();
        let library = library(&nonce);
        format!(
            "{BEGINNING}{nonce}'; \
             style-src 'unsafe-inline'; img-src data: blob:\">\n\
             <meta name=\"viewport\" content=\"width=device-width\">\n<title>{}</title>\n<style>{STYLE}</style>\n\
             </head>\n<body>\n{body}{library}\n\
             <script nonce=\"{nonce}\">\nconst plots = [{plots}];\n{DRAW}\n</script>\n</body>\n</html>\n",
            escaped(&self.title)
        )
    }

    fn body(&self) -> String {
        let mut out = String::new();
        // Writing to a String cannot fail.
        let _ = writeln!(
            out,
            "<header>\n<h1>{}</h1>\n<p>{}</p>\n<p class=\"hint\">{HINT}</p>\n</header>",
            escaped(&self.title),
            with_code(&self.lead)
        );
        out.push_str("<nav aria-label=\"Contents\">\n<h2>Contents</h2>\n<ol>\n");
        let mut number = 0;
        for Section { id, title, items } in &self.sections {
            let _ = write!(out, "<li><a href=\"#{id}\">{}</a>", escaped(title));
            let figures: Vec<&Figure> = items
                .iter()
                .filter_map(|item| if let Item::Figure(figure) = item { Some(figure) } else { None })
                .collect();
            if !figures.is_empty() {
                out.push_str("<ul>");
                for figure in figures {
                    number += 1;
                    let title = escaped(&figure.title);
                    let _ = write!(
                        out,
                        "<li><a href=\"#{}\">Figure {number}. {title}</a></li>",
                        escaped(&figure.id)
                    );
                }
                out.push_str("</ul>");
            }
            out.push_str("</li>\n");
        }
        out.push_str("</ol>\n</nav>\n<main>\n");
        let mut numbers = [0, 0];
        for Section { id, title, items } in &self.sections {
            let _ = writeln!(out, "<section id=\"{id}\">\n<h2>{}</h2>", escaped(title));
            items.iter().for_each(|item| write_item(&mut out, item, &mut numbers));
            out.push_str("</section>\n");
        }
        out.push_str("</main>\n");
        out
    }

    /// Pairs of element ids and plots, as the inside of an array.
    fn plots(&self) -> String {
        let mut plots = String::new();
        for figure in self.figures() {
            for (index, panel) in figure.panels.iter().enumerate() {
                let _ = writeln!(plots, "[\"{}-{index}\", {}],", figure.id, panel_json(figure, panel));
            }
        }
        plots
    }
}

/// The script of plotly.js as the crate brings it, without that of MathJax, which nothing here needs.
fn library(nonce: &str) -> String {
    let both = plotly::Plot::offline_js_sources();
    let script = both.split_once("</script>").map_or(both.as_str(), |(script, _)| script);
    let source = script.split_once('>').map_or(script, |(_, source)| source);
    format!("<script nonce=\"{nonce}\">{source}</script>")
}

fn write_item(out: &mut String, item: &Item, [figures, tables]: &mut [u32; 2]) {
    let _ = match item {
        Item::Text(text) => writeln!(out, "<p>{}</p>", with_code(text)),
        Item::Missing(text) => writeln!(out, "<p class=\"missing\">{}</p>", with_code(text)),
        Item::Table(table) => {
            *tables += 1;
            write_table(out, table, *tables);
            Ok(())
        }
        Item::Figure(figure) => {
            *figures += 1;
            write_figure(out, figure, *figures);
            Ok(())
        }
        Item::Details { summary, text } => {
            let text = text.lines().map(escaped).collect::<Vec<_>>().join("\n");
            writeln!(out, "<details>\n<summary>{}</summary>\n<pre>{text}</pre>\n</details>", escaped(summary))
        }
    };
}

fn write_table(out: &mut String, table: &TableBlock, number: u32) {
    let class = |column: usize| if column < table.texts { "" } else { " class=\"number\"" };
    let columns = table.rows.iter().map(Vec::len).max().unwrap_or(0);
    let dense = if columns >= DENSE { " class=\"dense\"" } else { "" };
    let caption = escaped(&table.caption);
    let _ = writeln!(
        out,
        "<p class=\"caption\" id=\"table-{number}\"><b>Table {number}.</b> {caption}</p>\n\
         <div class=\"wide\"><table aria-labelledby=\"table-{number}\"{dense}>"
    );
    if !table.head.is_empty() {
        out.push_str("<thead><tr>");
        for (column, name) in table.head.iter().enumerate() {
            let _ = write!(out, "<th scope=\"col\"{}>{}</th>", class(column), escaped(name));
        }
        out.push_str("</tr></thead>\n");
    }
    out.push_str("<tbody>\n");
    for row in &table.rows {
        out.push_str("<tr>");
        for (column, cell) in row.iter().enumerate() {
            let (tag, scope) = if column == 0 { ("th", " scope=\"row\"") } else { ("td", "") };
            let _ = write!(out, "<{tag}{scope}{}>{}</{tag}>", class(column), escaped(cell));
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</tbody>\n</table></div>\n");
}

fn write_figure(out: &mut String, figure: &Figure, number: u32) {
    let id = escaped(&figure.id);
    let _ = writeln!(out, "<figure id=\"{id}\">\n<div class=\"panels\">");
    for (index, panel) in figure.panels.iter().enumerate() {
        let (width, height) = (figure.panel_width(), panel.height);
        let label = escaped(if panel.title.is_empty() { &figure.title } else { &panel.title });
        let _ = writeln!(
            out,
            "<div class=\"plot\" id=\"{id}-{index}\" role=\"img\" aria-label=\"{label}\" \
             style=\"width:{width}px;height:{height}px\"></div>"
        );
    }
    if figure.panels.len() > 1 {
        write_legend(out, figure);
    }
    let (title, caption) = (escaped(&figure.title), escaped(&figure.caption));
    let _ = writeln!(
        out,
        "</div>\n<figcaption><b>Figure {number}. {title}.</b> {caption}</figcaption>\n</figure>"
    );
}

/// One legend for all panels.
fn write_legend(out: &mut String, figure: &Figure) {
    let mut met: Vec<&str> = Vec::new();
    out.push_str("<ul class=\"legend\">");
    for series in figure.panels.iter().flat_map(|panel| &panel.series) {
        if series.name.is_empty() || met.contains(&series.name.as_str()) {
            continue;
        }
        met.push(&series.name);
        let sample = super::svg::sample(series);
        let _ = write!(out, "<li>{sample} {}</li>", escaped(&series.name));
    }
    out.push_str("</ul>\n");
}

/// Text in which commands stand between backticks.
fn with_code(text: &str) -> String {
    let part = |(index, part): (usize, &str)| match index % 2 {
        0 => escaped(part),
        _ => format!("<code>{}</code>", escaped(part)),
    };
    text.split('`').enumerate().map(part).collect()
}

/// Text escaped for HTML, inside elements and attributes.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let text: Cow<'_, str> = printable(text);
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(name: &str) -> Page {
        let table = TableBlock {
            caption: name.to_owned(),
            head: vec![name.to_owned(), "b".to_owned()],
            rows: vec![vec![name.to_owned(), name.to_owned()]],
            texts: 1,
        };
        let text = || name.to_owned();
        let items = vec![
            Item::Text(text()),
            Item::Missing(text()),
            Item::Table(table),
            Item::Details { summary: text(), text: format!("{name}\n{name}") },
        ];
        Page { title: text(), lead: text(), sections: vec![Section { id: "s", title: "Section", items }] }
    }

    #[test]
    fn names_from_outside_are_text_wherever_they_stand() {
        let name = "<script>alert('x')</script><img src=\"http://example.org/\" onerror='alert(1)'>&";
        let html = page(name).body();
        assert!(!html.contains("<script") && !html.contains("<img") && !html.contains("\"http"), "{html}");
        assert_eq!(html.matches("&lt;script&gt;").count(), 11, "{html}");
    }

    #[test]
    fn a_page_loads_nothing_and_runs_only_its_own_scripts() {
        let html = page("plain").html();
        let (head, _) = html.split_once("</head>").unwrap();
        assert!(head.contains("default-src 'none'") && !head.contains("unsafe-eval"), "{head}");
        assert_eq!(html.matches("<script nonce=\"").count(), 2);
        assert_eq!(html.matches("</script>").count(), 2);
        assert!(!html.contains("<script src") && !html.contains("<link"));
        // plotly.js alone has 4.7 million bytes; MathJax, which comes with it, 2.1 million more.
        assert!(html.len() < 5_000_000, "{}", html.len());
        assert_eq!(html, page("plain").html());
    }
}
