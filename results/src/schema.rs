//! The schema document, made from the declared tables.

use std::fmt::Write;

use crate::columns::{Column, GeneColumn};
use crate::error::Error;
use crate::table_name::TableName;
use crate::tables::Table;
use artefact::metadata::SCHEMA_VERSION;

/// SCHEMA.md: every table with its columns, as Markdown.
pub fn schema_markdown() -> Result<String, Error> {
    let gene = GeneColumn {
        name: "<gene>".to_owned(),
        unit: "the gene's".to_owned(),
        integer: false,
        meaning: "one column for every gene of the experiment, by its name; null if the gene is not used"
            .to_owned(),
    };
    let mut text = format!(
        "# Schema of run folders, grid folders and artefacts, version {SCHEMA_VERSION}\n\n\
         Made from `results/src/tables/` by `results::schema_markdown`; a test keeps it so.\n\n\
         Columns are only added, never renamed or retyped, and those added later may be null. *null* marks columns \
         whose cells may be null, *digest* those that the run digest covers.\n",
    );
    for name in TableName::RUN
        .into_iter()
        .chain(TableName::FRONT)
        .chain(TableName::SETS)
        .chain(TableName::COMPARISON)
        .chain(TableName::PERTURBED)
        .chain(TableName::GRID)
        .chain(TableName::ARTEFACT)
    {
        let table = Table::new(name, std::slice::from_ref(&gene))?;
        let key: Vec<String> = table.key.iter().map(|column| format!("`{column}`")).collect();
        let key = if key.is_empty() { "the genes".to_owned() } else { key.join(", ") };
        // Writing into a String cannot fail.
        let _ = write!(
            text,
            "\n## {name}\n\nA row is {}. Key: {}.\n\n\
             | column | kind | unit | null | digest | meaning |\n|---|---|---|---|---|---|\n",
            table.meaning, key,
        );
        for column in &table.columns {
            let Column { name, unit, meaning, .. } = column;
            let kind = if column.gene { "u32 or f64" } else { column.kind.name() };
            let mark = |flag: bool, word: &'static str| if flag { word } else { "" };
            let (null, digest) = (mark(column.nullable, "null"), mark(column.in_digest, "digest"));
            let _ = writeln!(text, "| `{name}` | {kind} | {unit} | {null} | {digest} | {meaning} |");
        }
    }
    Ok(text)
}
