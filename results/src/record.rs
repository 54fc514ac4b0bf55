//! Declares a row once: from one list of fields follow its struct, its columns, its cells and its reader.
//!
//! [`record!`] takes fields as `name: Type, "unit", "meaning";` in column order. The type decides the column's kind,
//! `Option` makes it nullable, and the meaning is also the field's documentation. `field as "name"` gives the column
//! another name. A line that starts with `=>` is a column that is computed from the row and not part of the struct.
//! A field may itself be a record: its columns get the field's column name as a prefix, and in their meanings
//! `{prefix}` and `{of}` stand for that prefix and for the field's meaning.
//!
//! A column added later must be an `Option`: files without it are read as null.

use std::time::{Duration, SystemTime};

use polars::prelude::{
    DataFrame, DataType, Float32Type, IntoColumn, IntoSeries, ListBuilderTrait, ListPrimitiveChunkedBuilder,
    NamedFrom, Series,
};

use crate::columns::{Column, ColumnKind, GeneColumn};
use crate::error::Error;
use crate::population::PopulationSummary;

/// A column of a frame; [`Column`] is its declaration.
pub(crate) type Cells = polars::prelude::Column;

/// What the rows of one file share and their columns are computed from.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Context<'a> {
    /// The genes of the experiment, in the order of the gene columns.
    pub genes: &'a [GeneColumn],
    /// Values of the table's label columns, which are equal in all of these rows.
    pub labels: &'a [&'a str],
    /// Queries that every descriptor of a grid was evaluated with.
    pub queries: u32,
    /// What the recall of a curve is a share of.
    pub relevant: u64,
    /// The individuals of the generation.
    pub population: PopulationSummary,
}

/// How a field is declared.
#[derive(Clone, Debug, Default)]
pub(crate) struct Field {
    /// Name of its column, or prefix of its columns.
    pub name: String,
    pub unit: &'static str,
    pub meaning: String,
}

impl Field {
    /// A field of the record that this field holds.
    pub(crate) fn inner(&self, name: &str, unit: &'static str, meaning: &str) -> Self {
        let meaning = meaning.replace("{prefix}", &self.name).replace("{of}", &self.meaning);
        Self { name: format!("{}{name}", self.name), unit, meaning }
    }

    fn column(&self, kind: ColumnKind) -> Column {
        Column::new(&self.name, kind, self.unit, &self.meaning)
    }
}

/// What a field of a row may be: the value of one column, or of several.
pub(crate) trait Value: Sized {
    /// The columns of such a field.
    fn columns(field: &Field, genes: &[GeneColumn]) -> Vec<Column>;

    /// Their cells, one per row: null where there is no value.
    fn cells(name: &str, context: &Context, values: &[Option<&Self>]) -> Result<Vec<Cells>, Error>;

    /// Reads the cells of all rows: no value where a cell that is never null is null.
    fn read(name: &str, frame: &DataFrame, genes: &[GeneColumn]) -> Result<Vec<Option<Self>>, Error>;
}

/// Name of a field's column.
macro_rules! column_name {
    ($field:ident) => {
        stringify!($field)
    };
    ($field:ident $name:literal) => {
        $name
    };
}
pub(crate) use column_name;

/// Declares a record; see the module's documentation.
macro_rules! record {
    (
        $(#[$attribute:meta])*
        $visibility:vis struct $record:ident {
            $(
                $(#[$field_attribute:meta])*
                $field:ident $(as $name:literal)? : $type:ty, $unit:literal, $meaning:literal;
                $(=> $computed:ident: $kind:ty, $computed_unit:literal, $computed_meaning:literal = $of:expr;)*
            )*
        }
    ) => {
        $(#[$attribute])*
        $visibility struct $record {
            $($(#[$field_attribute])* #[doc = $meaning] pub $field: $type,)*
        }

        impl $crate::record::Value for $record {
            fn columns(
                field: &$crate::record::Field,
                genes: &[$crate::columns::GeneColumn],
            ) -> Vec<$crate::columns::Column> {
                let mut columns = Vec::new();
                $(
                    let name = $crate::record::column_name!($field $($name)?);
                    columns.extend(<$type>::columns(&field.inner(name, $unit, $meaning), genes));
                    $(
                        let computed = field.inner(stringify!($computed), $computed_unit, $computed_meaning);
                        columns.extend(<$kind>::columns(&computed, genes));
                    )*
                )*
                columns
            }

            fn cells(
                prefix: &str,
                context: &$crate::record::Context,
                rows: &[Option<&Self>],
            ) -> Result<Vec<$crate::record::Cells>, $crate::error::Error> {
                let mut cells = Vec::new();
                $(
                    let name = format!("{prefix}{}", $crate::record::column_name!($field $($name)?));
                    let values: Vec<_> = rows.iter().map(|row| row.map(|row| &row.$field)).collect();
                    cells.extend(<$type>::cells(&name, context, &values)?);
                    $(
                        let name = format!("{prefix}{}", stringify!($computed));
                        let of: fn(&Self, &$crate::record::Context) -> $kind = $of;
                        let values: Vec<_> = rows.iter().map(|row| row.map(|row| of(row, context))).collect();
                        let values: Vec<_> = values.iter().map(Option::as_ref).collect();
                        cells.extend(<$kind>::cells(&name, context, &values)?);
                    )*
                )*
                Ok(cells)
            }

            fn read(
                prefix: &str,
                frame: &polars::prelude::DataFrame,
                genes: &[$crate::columns::GeneColumn],
            ) -> Result<Vec<Option<Self>>, $crate::error::Error> {
                $(
                    let name = format!("{prefix}{}", $crate::record::column_name!($field $($name)?));
                    let mut $field = <$type>::read(&name, frame, genes)?.into_iter();
                )*
                let row = |_| {
                    $(let $field = $field.next().flatten();)*
                    Some(Self { $($field: $field?,)* })
                };
                Ok((0..frame.height()).map(row).collect())
            }
        }
    };
}
pub(crate) use record;

impl<T: Value> Value for Option<T> {
    fn columns(field: &Field, genes: &[GeneColumn]) -> Vec<Column> {
        T::columns(field, genes).into_iter().map(Column::nullable).collect()
    }

    fn cells(name: &str, context: &Context, values: &[Option<&Self>]) -> Result<Vec<Cells>, Error> {
        let values: Vec<_> = values.iter().map(|value| value.and_then(Option::as_ref)).collect();
        T::cells(name, context, &values)
    }

    fn read(name: &str, frame: &DataFrame, genes: &[GeneColumn]) -> Result<Vec<Option<Self>>, Error> {
        Ok(T::read(name, frame, genes)?.into_iter().map(Some).collect())
    }
}

/// A type of one column: its kind, what polars stores of a value, and how that is read.
macro_rules! scalar {
    ($type:ty, $kind:ident, $stored:expr, $chunks:ident, $read:expr) => {
        impl Value for $type {
            fn columns(field: &Field, _: &[GeneColumn]) -> Vec<Column> {
                vec![field.column(ColumnKind::$kind)]
            }

            fn cells(name: &str, _: &Context, values: &[Option<&Self>]) -> Result<Vec<Cells>, Error> {
                let stored: Vec<_> = values.iter().map(|value| value.map($stored)).collect();
                let cells = Series::new(name.into(), stored).cast(&ColumnKind::$kind.data_type())?;
                Ok(vec![cells.into_column()])
            }

            fn read(name: &str, frame: &DataFrame, _: &[GeneColumn]) -> Result<Vec<Option<Self>>, Error> {
                let cells = frame.column(name)?.to_physical_repr();
                Ok(cells.$chunks()?.iter().map(|cell| cell.map($read)).collect())
            }
        }
    };
}

scalar!(u32, U32, |value| *value, u32, |cell| cell);
scalar!(u64, U64, |value| *value, u64, |cell| cell);
scalar!(f32, F32, |value| *value, f32, |cell| cell);
scalar!(f64, F64, |value| *value, f64, |cell| cell);
scalar!(bool, Bool, |value| *value, bool, |cell| cell);
scalar!(String, Text, String::as_str, str, str::to_owned);
scalar!(SystemTime, Timestamp, |value| milliseconds(*value), i64, time);

/// Milliseconds since the Unix epoch, negative before it.
fn milliseconds(at: SystemTime) -> i64 {
    let whole = |span: Duration| i64::try_from(span.as_millis()).unwrap_or(i64::MAX);
    match at.duration_since(SystemTime::UNIX_EPOCH) {
        Ok(after) => whole(after),
        Err(before) => -whole(before.duration()),
    }
}

/// Undoes [`milliseconds`]; the epoch itself for a time that this system cannot represent.
fn time(milliseconds: i64) -> SystemTime {
    let span = Duration::from_millis(milliseconds.unsigned_abs());
    let epoch = SystemTime::UNIX_EPOCH;
    let time = if milliseconds < 0 { epoch.checked_sub(span) } else { epoch.checked_add(span) };
    time.unwrap_or(epoch)
}

/// Lists of numbers.
impl Value for Vec<f32> {
    fn columns(field: &Field, _: &[GeneColumn]) -> Vec<Column> {
        vec![field.column(ColumnKind::F32List)]
    }

    fn cells(name: &str, _: &Context, values: &[Option<&Self>]) -> Result<Vec<Cells>, Error> {
        let length = values.iter().flatten().map(|list| list.len()).sum();
        let mut lists = ListPrimitiveChunkedBuilder::<Float32Type>::new(
            name.into(),
            values.len(),
            length,
            DataType::Float32,
        );
        for list in values {
            lists.append_opt_slice(list.map(Vec::as_slice));
        }
        Ok(vec![lists.finish().into_series().into_column()])
    }

    fn read(name: &str, frame: &DataFrame, _: &[GeneColumn]) -> Result<Vec<Option<Self>>, Error> {
        let lists = frame.column(name)?.list()?;
        // A null inside a list is no finite number either: whoever checks the values finds both.
        let list = |cells: Series| -> Result<Self, Error> {
            Ok(cells.f32()?.iter().map(|cell| cell.unwrap_or(f32::NAN)).collect())
        };
        (0..lists.len()).map(|row| lists.get_as_series(row).map(list).transpose()).collect()
    }
}

/// Ends of a 95 % interval.
impl Value for [f64; 2] {
    fn columns(field: &Field, genes: &[GeneColumn]) -> Vec<Column> {
        let end = |name: &str, which: &str| {
            let meaning = format!("{which} end of the 95 % interval of {}", field.meaning);
            f64::columns(&Field { name: format!("{}_{name}", field.name), meaning, ..field.clone() }, genes)
        };
        [end("low", "lower"), end("high", "upper")].concat()
    }

    fn cells(name: &str, context: &Context, values: &[Option<&Self>]) -> Result<Vec<Cells>, Error> {
        let end = |index: usize, end: &str| {
            let ends: Vec<_> = values.iter().map(|value| value.map(|ends| &ends[index])).collect();
            f64::cells(&format!("{name}_{end}"), context, &ends)
        };
        Ok([end(0, "low")?, end(1, "high")?].concat())
    }

    fn read(name: &str, frame: &DataFrame, genes: &[GeneColumn]) -> Result<Vec<Option<Self>>, Error> {
        let end = |end: &str| f64::read(&format!("{name}_{end}"), frame, genes);
        let ends = |(low, high): (Option<f64>, Option<f64>)| Some([low?, high?]);
        Ok(end("low")?.into_iter().zip(end("high")?).map(ends).collect())
    }
}

/// Values of one gene, in its unit, one a row.
pub(crate) fn gene_cells(prefix: &str, gene: &GeneColumn, values: &[Option<f64>]) -> Result<Cells, Error> {
    let column = gene.column(prefix);
    Ok(Series::new(column.key(), values).cast(&column.kind.data_type())?.into_column())
}

/// Values of the genes, in their units and in the order of the gene columns; `None` for a gene that is not used.
impl Value for Vec<Option<f64>> {
    fn columns(field: &Field, genes: &[GeneColumn]) -> Vec<Column> {
        genes.iter().map(|gene| gene.column(&field.name)).collect()
    }

    fn cells(name: &str, context: &Context, values: &[Option<&Self>]) -> Result<Vec<Cells>, Error> {
        let gene = |(index, gene): (usize, &GeneColumn)| {
            let values = values.iter().map(|genes| genes.and_then(|genes| *genes.get(index)?));
            gene_cells(name, gene, &values.collect::<Vec<_>>())
        };
        context.genes.iter().enumerate().map(gene).collect()
    }

    fn read(name: &str, frame: &DataFrame, genes: &[GeneColumn]) -> Result<Vec<Option<Self>>, Error> {
        let mut rows = vec![Some(Self::new()); frame.height()];
        for gene in genes {
            let cells = frame.column(&format!("{name}{}", gene.name))?.cast(&DataType::Float64)?;
            for (row, cell) in rows.iter_mut().flatten().zip(cells.f64()?.iter()) {
                row.push(cell);
            }
        }
        Ok(rows)
    }
}
