//! The page: sections of text, tables, figures and clouds as one self-contained HTML document.

use std::fmt::Write as _;

use super::draw;
use super::escape::{escaped, with_code};
use super::figure::{Figure, Marks, Numbers, Panel, Scale, Series, WIDTH};
use super::numbers::{spoken, tables};
use super::palette;
use super::table::TableBlock;
use super::thin::thinned;
use super::wrong::{WrongClouds, gallery};
use crate::error::Error;

const STYLE: &str = include_str!("style.css");
/// The script that shows point clouds.
pub(crate) const VIEWER: &str = include_str!("viewer.js");
const GALLERY: &str = include_str!("gallery.js");

/// How every page begins, up to the nonce of its script and style.
const BEGINNING: &str = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
    <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'nonce-";

/// Whether a text begins as every page does.
pub(crate) fn begins_page(text: &str) -> bool {
    text.starts_with(BEGINNING)
}

/// Bytes that a page with clouds may have.
const LARGEST: usize = 2_000_000;

/// Columns from which on a table is set smaller, so that it fits on a sheet.
const DENSE: usize = 9;

/// Width of a figure on a telephone, pixels.
const NARROW: u32 = 358;
/// Heights of panels end there on a telephone.
const NARROW_HEIGHT: u32 = 300;
/// Names along an axis that fit on a telephone.
const FEW_NAMES: usize = 12;

/// A part of a section.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Item {
    /// A paragraph.
    Text(String),
    /// What the report comes to.
    Verdict(Vec<String>),
    /// What is missing, and how to get it.
    Missing(String),
    /// A table.
    Table(TableBlock),
    /// A table whose rows lead elsewhere.
    Links {
        /// The table.
        table: TableBlock,
        /// The address of each row; `None`: it leads nowhere.
        addresses: Vec<Option<String>>,
    },
    /// A figure.
    Figure(Figure),
    /// Clouds in 3D that the winner took for others.
    Wrong(Vec<WrongClouds>),
    /// Text that is folded away, line by line.
    Details {
        /// What it is.
        summary: String,
        /// The text.
        text: String,
    },
}

/// Adds a figure, with marks that can be told apart, if there is something to draw.
pub(crate) fn add(items: &mut Vec<Item>, figure: Figure) {
    if !figure.is_empty() {
        items.push(Item::Figure(thinned(figure)));
    }
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
    ///
    /// # Errors
    /// If a figure cannot be drawn.
    pub fn html(&self) -> Result<String, Error> {
        let mut body = self.body()?;
        let mut style = palette::style();
        style.push_str(STYLE);
        let scripts = VIEWER.len() + GALLERY.len();
        let room = LARGEST.saturating_sub(body.len() + style.len() + scripts + 2000);
        let clouds = self.wrong().and_then(|wrong| gallery(wrong, room));
        let (figures, json) = clouds.unwrap_or_default();
        body = body.replacen(CLOUDS, &figures, 1);
        // Only what carries it takes effect: not what a name might smuggle in.
        let nonce = blake3::hash(format!("{body}{json}").as_bytes()).to_hex();
        let scripts = if json.is_empty() {
            String::new()
        } else {
            format!(
                "<script type=\"application/json\" id=\"clouds\">{json}</script>\n\
                 <script type=\"module\" nonce=\"{nonce}\">\n{VIEWER}\n{GALLERY}</script>\n"
            )
        };
        Ok(format!(
            "{BEGINNING}{nonce}'; style-src 'nonce-{nonce}'; base-uri 'none'; form-action 'none'\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{}</title>\n\
             <style nonce=\"{nonce}\">{style}</style>\n</head>\n<body>\n{body}{scripts}</body>\n</html>\n",
            escaped(&self.title)
        ))
    }

    fn wrong(&self) -> Option<&[WrongClouds]> {
        self.sections.iter().flat_map(|section| &section.items).find_map(|item| match item {
            Item::Wrong(wrong) => Some(wrong.as_slice()),
            _ => None,
        })
    }

    fn body(&self) -> Result<String, Error> {
        let mut out = String::new();
        // Writing to a String cannot fail.
        let _ = writeln!(
            out,
            "<header>\n<h1>{}</h1>\n<p>{}</p>\n</header>",
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
                    let (id, title) = (escaped(&figure.id), escaped(&figure.title));
                    let _ = write!(out, "<li><a href=\"#{id}\">Figure {number}. {title}</a></li>");
                }
                out.push_str("</ul>");
            }
            out.push_str("</li>\n");
        }
        out.push_str("</ol>\n</nav>\n<main>\n");
        let mut numbers = [0, 0];
        for Section { id, title, items } in &self.sections {
            let _ = writeln!(out, "<section id=\"{id}\">\n<h2>{}</h2>", escaped(title));
            items.iter().try_for_each(|item| write_item(&mut out, item, &mut numbers))?;
            out.push_str("</section>\n");
        }
        out.push_str("</main>\n");
        Ok(out)
    }
}

/// Where the clouds stand, until it is known how much room there is for them. No text has it: they are escaped.
const CLOUDS: &str = "<!--clouds-->";

fn write_item(out: &mut String, item: &Item, [figures, numbers]: &mut [u32; 2]) -> Result<(), Error> {
    let _ = match item {
        Item::Text(text) => writeln!(out, "<p>{}</p>", with_code(text)),
        Item::Verdict(sentences) => {
            out.push_str("<div class=\"verdict\">\n");
            for sentence in sentences {
                let _ = writeln!(out, "<p>{}</p>", with_code(sentence));
            }
            writeln!(out, "</div>")
        }
        Item::Missing(text) => writeln!(out, "<p class=\"missing\">{}</p>", with_code(text)),
        Item::Table(table) => {
            *numbers += 1;
            write_table(out, table, &format!("table-{numbers}"), Some(*numbers), &[]);
            Ok(())
        }
        Item::Links { table, addresses } => {
            *numbers += 1;
            write_table(out, table, &format!("table-{numbers}"), Some(*numbers), addresses);
            Ok(())
        }
        Item::Figure(figure) => {
            *figures += 1;
            write_figure(out, figure, *figures)?;
            Ok(())
        }
        Item::Wrong(_) => writeln!(out, "{CLOUDS}"),
        Item::Details { summary, text } => {
            let text = text.lines().map(escaped).collect::<Vec<_>>().join("\n");
            writeln!(out, "<details>\n<summary>{}</summary>\n<pre>{text}</pre>\n</details>", escaped(summary))
        }
    };
    Ok(())
}

/// Writes a table under its caption, whose anchor is `id`.
fn write_table(
    out: &mut String,
    table: &TableBlock,
    id: &str,
    number: Option<u32>,
    addresses: &[Option<String>],
) {
    let class = |column: usize| if column < table.texts { "" } else { " class=\"number\"" };
    let columns = table.rows.iter().map(Vec::len).max().unwrap_or(0);
    let dense = if columns >= DENSE { " class=\"dense\"" } else { "" };
    let number = number.map_or_else(String::new, |number| format!("<b>Table {number}.</b> "));
    let (id, caption) = (escaped(id), with_code(&table.caption));
    let _ = writeln!(
        out,
        "<p class=\"caption\" id=\"{id}\">{number}{caption}</p>\n\
         <div class=\"wide\" role=\"region\" tabindex=\"0\" aria-labelledby=\"{id}\">\
         <table aria-labelledby=\"{id}\"{dense}>"
    );
    if !table.head.is_empty() {
        out.push_str("<thead><tr>");
        for (column, name) in table.head.iter().enumerate() {
            let _ = write!(out, "<th scope=\"col\"{}>{}</th>", class(column), escaped(name));
        }
        out.push_str("</tr></thead>\n");
    }
    out.push_str("<tbody>\n");
    for (row, cells) in table.rows.iter().enumerate() {
        out.push_str("<tr>");
        for (column, cell) in cells.iter().enumerate() {
            let (tag, scope) = if column == 0 { ("th", " scope=\"row\"") } else { ("td", "") };
            let address = addresses.get(row).and_then(Option::as_deref).filter(|_| column == 0);
            let cell = match address {
                Some(address) => format!("<a href=\"{}\">{}</a>", escaped(address), escaped(cell)),
                None => escaped(cell),
            };
            let _ = write!(out, "<{tag}{scope}{}>{cell}</{tag}>", class(column));
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</tbody>\n</table></div>\n");
}

fn write_figure(out: &mut String, figure: &Figure, number: u32) -> Result<(), Error> {
    let id = escaped(&figure.id);
    let _ = writeln!(out, "<figure id=\"{id}\">");
    // Who has no mouse scrolls what has the focus.
    let scrolls = if figure.panels.iter().any(is_large) { " tabindex=\"0\" role=\"group\"" } else { "" };
    let _ = writeln!(out, "<div class=\"panels\"{scrolls}>");
    for panel in &figure.panels {
        let label = spoken(figure, panel);
        let is_large = is_large(panel);
        let width = figure.panel_width();
        // A wide figure is drawn again for telephones: its letters would shrink with it. A large matrix is scrolled.
        let classes = match width == WIDTH {
            _ if is_large => "plot large",
            true => "plot broad",
            false => "plot",
        };
        out.push_str(&draw::panel(figure, panel, width, classes, &label)?);
        out.push('\n');
        if width == WIDTH && !is_large {
            let narrow = Panel { height: panel.height.min(narrow_height(panel)), ..panel.clone() };
            out.push_str(&draw::panel(figure, &narrow, NARROW, "plot narrow", &label)?);
            out.push('\n');
        }
    }
    out.push_str("</div>\n");
    write_legend(out, figure);
    let (title, caption) = (escaped(&figure.title), with_code(&figure.caption));
    let _ = writeln!(out, "<figcaption><b>Figure {number}. {title}.</b> {caption}</figcaption>");
    let tables = if figure.numbers == Numbers::Below { tables(figure) } else { Vec::new() };
    if !tables.is_empty() {
        let _ = writeln!(out, "<details class=\"numbers\">\n<summary>Numbers of figure {number}</summary>");
        for (index, table) in tables.iter().enumerate() {
            write_table(out, table, &format!("{}-numbers-{index}", figure.id), None, &[]);
        }
        out.push_str("</details>\n");
    }
    out.push_str("</figure>\n");
    Ok(())
}

/// Whether a panel is a matrix of so many names that they would not be read if it were made smaller.
fn is_large(panel: &Panel) -> bool {
    let is_large = |series: &Series| match &series.marks {
        Marks::Matrix { cells, .. } => {
            cells.len() > FEW_NAMES || cells.first().is_some_and(|row| row.len() > FEW_NAMES)
        }
        _ => false,
    };
    !matches!(panel.x.scale, Scale::Values(_)) && panel.series.iter().any(is_large)
}

/// Rows of names need their height; a curve does not.
fn narrow_height(panel: &Panel) -> u32 {
    match panel.y.scale {
        Scale::Names(_) => panel.height,
        _ => NARROW_HEIGHT,
    }
}

/// One legend for all panels.
fn write_legend(out: &mut String, figure: &Figure) {
    let entries = draw::legend(figure);
    if entries.is_empty() {
        return;
    }
    out.push_str("<ul class=\"legend\">");
    for series in entries {
        let _ = write!(out, "<li>{} {}</li>", draw::sample(series), escaped(&series.name));
    }
    out.push_str("</ul>\n");
}

#[cfg(test)]
mod tests {
    use super::super::wrong::ShownCloud;
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
            Item::Verdict(vec![text()]),
            Item::Missing(text()),
            Item::Table(table.clone()),
            Item::Links { table, addresses: vec![Some("../a/report.html".to_owned())] },
            Item::Details { summary: text(), text: format!("{name}\n{name}") },
        ];
        Page { title: text(), lead: text(), sections: vec![Section { id: "s", title: "Section", items }] }
    }

    fn wrong(name: &str, points: usize) -> Vec<WrongClouds> {
        let cloud = |role: &str, triple: usize| ShownCloud {
            name: format!("{name} {role} {triple}"),
            object: name.to_owned(),
            points: (0..points).map(|n| [n as f32, 0.0, 1.0]).collect(),
            colours: vec![[1, 2, 3]; points],
            total: 5000,
        };
        let triple = |n| WrongClouds {
            query: cloud("q", n),
            answer: cloud("a", n),
            right: Some(cloud("r", n)),
            ..WrongClouds::default()
        };
        (0..30).map(triple).collect()
    }

    #[test]
    fn names_from_outside_are_text_wherever_they_stand() {
        let name = "<script>alert('x')</script><img src=\"http://example.org/\" onerror='alert(1)'>&";
        let html = page(name).body().unwrap();
        assert!(!html.contains("<script") && !html.contains("<img") && !html.contains("\"http"), "{html}");
        assert_eq!(html.matches("&lt;script&gt;").count(), 16, "{html}");
        assert!(html.contains("<a href=\"../a/report.html\">&lt;script&gt;"));
    }

    #[test]
    fn a_page_loads_nothing_and_runs_only_its_own_script() {
        let html = page("plain").html().unwrap();
        let (head, _) = html.split_once("</head>").unwrap();
        for refused in ["default-src 'none'", "base-uri 'none'"] {
            assert!(head.contains(refused), "{head}");
        }
        assert!(!head.contains("unsafe"), "{head}");
        assert!(!html.contains("<script") && !html.contains("<link") && !html.contains(" style="));
        assert!(html.len() < 20_000, "{}", html.len());
        assert_eq!(html, page("plain").html().unwrap());
    }

    #[test]
    fn clouds_keep_the_page_small_and_their_names_are_text() {
        let name = "</script><script>alert(1)</script>";
        let mut page = page("plain");
        page.sections[0].items.push(Item::Wrong(wrong(name, 20_000)));
        let html = page.html().unwrap();
        assert!((1_000_000..LARGEST).contains(&html.len()), "{}", html.len());
        assert_eq!((html.matches("<script").count(), html.matches("</script").count()), (2, 2));
        assert_eq!(html.matches("<canvas").count(), 90);
        // An end of a script in a script would end it.
        assert!(!VIEWER.contains("</script") && !GALLERY.contains("</script") && !VIEWER.contains("<!--"));
    }
}
