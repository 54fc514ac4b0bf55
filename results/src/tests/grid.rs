//! The grid folder: what is written is read again, what is damaged is seen.

use std::fs;
use std::time::{Duration, SystemTime};

use tempfile::tempdir;

use super::fixture::{self, frame};
use crate::read::read_file_if_any;
use crate::record::Context;
use crate::tables::Table;
use crate::tables::grid::CellRow;
use crate::*;

fn points() -> CellPoints {
    let column = |values: [f64; 4]| values.map(Some).to_vec();
    CellPoints {
        genes: vec![
            column([8.0, 8.0, 9.0, 9.0]),
            vec![None; 4],
            column([1.3; 4]),
            column([0.0, 0.25, 0.0, 0.25]),
        ],
        object_correct: vec![3, 9, 0, 9],
        worker_id: Some("07".repeat(16)),
        principal: Some("token 192.0.2.7".to_owned()),
        seconded: Some("address 192.0.2.8".to_owned()),
        basis: Some("audited".to_owned()),
    }
}

fn best() -> Vec<BestRow> {
    let row = |rank, shape_bins, object_correct| BestRow {
        rank,
        genes: vec![Some(shape_bins), None, Some(1.3), Some(0.25)],
        object_correct,
    };
    vec![row(1, 8.0, 9), row(2, 9.0, 9)]
}

fn tables() -> GridTables {
    GridTables {
        grid: GridRow {
            name: "sample".to_owned(),
            grid_key: "ab".repeat(32),
            search_space: "unit = \"m\"\n".to_owned(),
            train_digest: "cd".repeat(32),
            evaluation_version: 1,
            cells: 1,
            descriptors: 4,
            queries: 9,
            optimal_descriptors: 2,
            best_genes: best().remove(0).genes,
            best_object_correct: 9,
            grid_digest: "ef".repeat(32),
            cells_computed: 1,
            cells_found: 0,
            run: Some("12".repeat(16)),
            principals: Some("address 192.0.2.8, token 192.0.2.7".to_owned()),
            basis: Some("audited".to_owned()),
            seconds: 1.5,
            finished_at: SystemTime::UNIX_EPOCH + Duration::from_millis(1_700_000_005_456),
        },
        best: best(),
        marginals: vec![MarginalRow {
            gene: "shape_bins".to_owned(),
            value: 8.0,
            descriptors: 2,
            best: 9,
            mean: 6.0,
            median: 6.0,
            worst: 3,
        }],
        landscapes: vec![LandscapeRow {
            gene_a: "shape_bins".to_owned(),
            value_a: 8.0,
            gene_b: "w".to_owned(),
            value_b: 0.25,
            descriptors: 1,
            best: 9,
            mean: 9.0,
        }],
        counts: [(0, 1), (3, 1), (9, 2)]
            .map(|(object_correct, descriptors)| CountRow { object_correct, descriptors })
            .to_vec(),
    }
}

#[test]
fn cells_and_tables_are_read_as_they_were_written() {
    let folder = tempdir().unwrap();
    let grid = GridFolder::create(folder.path(), &fixture::genes()).unwrap();
    assert_eq!(grid.read_cell("a").unwrap(), None);
    grid.write_cell("a", &points()).unwrap();
    assert_eq!(grid.read_cell("a").unwrap(), Some(points()));
    assert!(matches!(read_grid(folder.path()), Err(Error::UnfinishedGrid(_))));
    assert!(matches!(GridFolder::create(folder.path(), &fixture::genes()), Err(Error::InUse(_))));
    drop(grid);

    let grid = GridFolder::create(folder.path(), &fixture::genes()).unwrap();
    assert_eq!(grid.read_cell("a").unwrap(), Some(points()));
    grid.write_tables(&tables()).unwrap();
    let GridTables { grid: row, best, counts, .. } = tables();
    assert_eq!(read_grid(folder.path()).unwrap(), FinishedGrid { row, best, counts });
    for (table, rows) in TableName::GRID.into_iter().zip([4, 2, 1, 1, 3, 1]) {
        assert_eq!(read_table(folder.path(), table).unwrap().height(), rows, "{table}");
    }
    let marginals = read_table(folder.path(), TableName::Marginals).unwrap();
    let error = |column: &str| marginals.column(column).unwrap().f64().unwrap().get(0);
    assert_eq!(error("best_object_error"), Some(0.0));
    assert_eq!(error("mean_object_error"), Some(3.0 / 9.0));
    assert_eq!(error("worst_object_error"), Some(6.0 / 9.0));
}

/// A cell's file has what rows would have given it.
#[test]
fn the_columns_of_a_cell_are_those_of_its_rows() {
    let folder = tempdir().unwrap();
    let grid = GridFolder::create(folder.path(), &fixture::genes()).unwrap();
    let by_nobody = CellPoints { worker_id: None, principal: None, seconded: None, basis: None, ..points() };
    let empty = CellPoints { genes: vec![Vec::new(); 4], object_correct: Vec::new(), ..points() };
    for (number, points) in [points(), by_nobody, empty].into_iter().enumerate() {
        let row = |(index, &object_correct): (usize, &u32)| CellRow {
            genes: points.genes.iter().map(|values| values[index]).collect(),
            object_correct,
            worker_id: points.worker_id.clone(),
            principal: points.principal.clone(),
            seconded: points.seconded.clone(),
            basis: points.basis.clone(),
        };
        let rows: Vec<CellRow> = points.object_correct.iter().enumerate().map(row).collect();
        let table = Table::new(TableName::Cells, &fixture::genes()).unwrap();
        let expected = table.filled(&rows, Context::default()).unwrap();
        let name = number.to_string();
        grid.write_cell(&name, &points).unwrap();
        let file = folder.path().join("cells").join(format!("cell-{name}.parquet"));
        let found = read_file_if_any(&file, TableName::Cells).unwrap().unwrap();
        assert_eq!(found.frame.schema(), expected.frame.schema());
        assert!(found.frame.equals_missing(&expected.frame), "{} is not {}", found.frame, expected.frame);
    }
}

#[test]
fn a_damaged_cell_is_damage_wherever_a_bit_is_flipped() {
    let folder = tempdir().unwrap();
    let grid = GridFolder::create(folder.path(), &fixture::genes()).unwrap();
    grid.write_cell("a", &points()).unwrap();
    let file = folder.path().join("cells/cell-a.parquet");
    let sound = fs::read(&file).unwrap();
    for byte in 0..sound.len() {
        let mut bytes = sound.clone();
        bytes[byte] ^= 0x10;
        fs::write(&file, bytes).unwrap();
        assert!(grid.read_cell("a").unwrap_err().is_damage(), "byte {byte}");
        fs::write(&file, &sound[..byte]).unwrap();
        assert!(grid.read_cell("a").unwrap_err().is_damage(), "{byte} bytes");
    }
}

#[test]
fn rows_that_cannot_be_true_are_refused() {
    let folder = tempdir().unwrap();
    let grid = GridFolder::create(folder.path(), &fixture::genes()).unwrap();
    let mut short = points();
    short.genes[0].pop();
    assert!(grid.write_cell("a", &short).is_err());
    let mut too_good = tables();
    too_good.best[0].object_correct = 10;
    assert!(grid.write_tables(&too_good).is_err());
    assert!(matches!(read_grid(folder.path()), Err(Error::UnfinishedGrid(_))));
}

/// Each row struct gives exactly the table's columns, in its order, of its kinds.
#[test]
fn row_structs_and_column_table_do_not_drift_apart() {
    let genes = fixture::genes();
    let GridTables { grid, best, marginals, landscapes, counts } = tables();
    let context = Context { queries: 9, ..Context::default() };
    let cell = CellRow {
        genes: best[0].genes.clone(),
        object_correct: 9,
        worker_id: None,
        principal: None,
        seconded: None,
        basis: None,
    };
    let frames = [
        (TableName::Cells, frame(TableName::Cells, &[cell], context)),
        (TableName::Best, frame(TableName::Best, &best, context)),
        (TableName::Marginals, frame(TableName::Marginals, &marginals, context)),
        (TableName::Landscapes, frame(TableName::Landscapes, &landscapes, context)),
        (TableName::Counts, frame(TableName::Counts, &counts, context)),
        (TableName::Grid, frame(TableName::Grid, &[grid], context)),
    ];
    assert_eq!(frames.each_ref().map(|(name, _)| *name), TableName::GRID);
    for (name, frame) in frames {
        let (table, frame) = (Table::new(name, &genes).unwrap(), frame);
        let expected: Vec<_> =
            table.columns.iter().map(|column| (column.name.clone(), column.kind.data_type())).collect();
        let got: Vec<_> =
            frame.columns().iter().map(|cell| (cell.name().to_string(), cell.dtype().clone())).collect();
        assert_eq!(expected, got, "{name}");
    }
}

#[test]
fn counts_that_do_not_ascend_are_damage() {
    for correct in [[3, 0], [3, 3]] {
        let folder = tempdir().unwrap();
        let grid = GridFolder::create(folder.path(), &fixture::genes()).unwrap();
        let counts = correct.map(|object_correct| CountRow { object_correct, descriptors: 1 }).to_vec();
        grid.write_tables(&GridTables { counts, ..tables() }).unwrap();
        let error = read_grid(folder.path()).unwrap_err();
        assert!(error.to_string().contains("its counts do not ascend"), "{error}");
    }
}
