//! One table of all members as a lazy frame that decodes the columns a statement needs, when it needs them.

use std::any::Any;
use std::sync::Arc;

use polars::prelude::{
    AnonymousScan, AnonymousScanArgs, Column as Cell, DataFrame, DataType, LazyFrame, PlSmallStr,
    PolarsError, PolarsResult, ScanArgsAnonymous, Schema, SchemaRef,
};

use super::folders::{Member, RUN_FOLDER};
use crate::columns::Column;
use crate::error::Error;
use crate::parquet::VerifiedFile;
use crate::read::{read_bytes, stack, table_files, union};
use crate::table_name::TableName;

/// A table whose files are verified but not yet decoded.
#[derive(Clone)]
pub(super) struct OpenTable(Arc<Scan>);

struct Scan {
    schema: SchemaRef,
    /// With the member's name if rows have the column `run_folder`.
    files: Vec<(Option<PlSmallStr>, VerifiedFile)>,
}

impl OpenTable {
    /// Reads the table's files of all members that have it.
    pub(super) fn open(members: &[Member], table: TableName, several: bool) -> Result<Self, Error> {
        let mut files = Vec::new();
        for member in members {
            for file in table_files(&member.folder, table)? {
                let owner = several.then(|| PlSmallStr::from_str(&member.name));
                files.push((owner, VerifiedFile::open(read_bytes(&file)?, table, &file)?));
            }
        }
        let mut schemas = Vec::new();
        for (_, file) in &files {
            schemas.push((file.schema()?, file.file.as_path()));
        }
        let mut schema = union(schemas.iter().map(|(schema, file)| (schema, *file)))?;
        if several {
            schema.insert_at_index(0, PlSmallStr::from_static(RUN_FOLDER), DataType::String)?;
        }
        Ok(Self(Arc::new(Scan { schema: Arc::new(schema), files })))
    }

    pub(super) fn schema(&self) -> &Schema {
        &self.0.schema
    }

    /// What is known of its columns, each once.
    pub(super) fn columns(&self) -> Vec<Column> {
        let mut columns: Vec<Column> = Vec::new();
        for column in self.0.files.iter().flat_map(|(_, file)| &file.table.columns) {
            if columns.iter().all(|known| known.name != column.name) {
                columns.push(column.clone());
            }
        }
        columns
    }

    pub(super) fn lazy(&self) -> PolarsResult<LazyFrame> {
        let schema = Some(Arc::clone(&self.0.schema));
        let scan: Arc<dyn AnonymousScan> = Arc::clone(&self.0) as _;
        LazyFrame::anonymous_scan(scan, ScanArgsAnonymous { schema, name: "TABLE", ..Default::default() })
    }
}

/// Conditions are left to polars: it would hand over only those that it can write as an expression, and take for
/// granted that all of them were applied.
impl AnonymousScan for Scan {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn allows_projection_pushdown(&self) -> bool {
        true
    }

    fn scan(&self, wanted: AnonymousScanArgs) -> PolarsResult<DataFrame> {
        let schema = match &wanted.with_columns {
            Some(columns) => self.schema.try_project(columns.iter())?,
            None => Schema::clone(&self.schema),
        };
        let columns: Vec<PlSmallStr> = schema.iter_names().cloned().collect();
        let mut frames = Vec::new();
        let (mut rows, limit) = (0, wanted.n_rows.unwrap_or(usize::MAX));
        for (owner, file) in &self.files {
            if rows >= limit {
                break;
            }
            // Its checksum holds, so that only a file of another program can fail here.
            let frame = file
                .frame(Some(&columns))
                .map_err(|error| PolarsError::ComputeError(error.to_string().into()))?;
            let height = file.height();
            let mut cells = frame.into_columns();
            if let Some(owner) = owner {
                let name = PlSmallStr::from_static(RUN_FOLDER);
                cells.push(Cell::new_scalar(name, owner.clone().into(), height));
            }
            frames.push(DataFrame::new(height, cells)?);
            rows += height;
        }
        Ok(stack(frames, &schema)?.head(Some(limit)))
    }
}
