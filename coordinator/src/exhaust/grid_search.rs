//! The evaluation of a whole grid: cells that are there are read, the others computed by the workers.

use std::collections::BTreeMap;
use std::time::{Instant, SystemTime};

use descriptor::{Descriptor, EVALUATION_VERSION};
use proto::Message;
use proto::task::{GridCell, Task};
use results::{FinishedGrid, GridFolder, GridRow, GridTables, read_grid};

use super::cell_task::cell_subject;
use super::cells::{Cells, CountedBy};
use super::grid_spec::GridSpec;
use super::landscape::Landscape;
use crate::result_cache::source::{basis_name, basis_of, principals_text};
use crate::result_cache::{Wrong, finished_runs};
use crate::run::RunError;
use crate::run::progress::{CellReport, Progress};
use crate::session::Session;
use cluster::scheduler::{Basis, Provenance};
use cluster::{CellAnswer, Client, ClusterNews};

/// Counts of a cell, and who counted.
type Counted = (Vec<u32>, Option<CountedBy>);

/// One exhaustive search under way.
pub struct GridSearch<'a> {
    /// What is asked.
    pub spec: &'a GridSpec,
    /// Name of the experiment.
    pub name: &'a str,
    /// Where the cells are kept.
    pub folder: &'a GridFolder,
    /// Who computes them.
    pub session: &'a Session<'a>,
}

impl GridSearch<'_> {
    /// Evaluates the cells that the folder lacks, and writes the tables over all of them.
    pub async fn run(self, client: &mut Client, progress: &mut Progress) -> Result<FinishedGrid, RunError> {
        loop {
            if let Some(finished) = self.fill(client, progress).await? {
                return Ok(finished);
            }
        }
    }

    /// Evaluates the cells that the folder lacks; `None` if some were found to be in doubt meanwhile, and were removed.
    async fn fill(
        &self,
        client: &mut Client,
        progress: &mut Progress,
    ) -> Result<Option<FinishedGrid>, RunError> {
        let started = Instant::now();
        let Self { spec, folder, .. } = self;
        let grid = &spec.grid;
        let mut landscape = Landscape::new(grid, spec.queries);
        let (mut asked, mut cells, mut unsettled) = (Vec::new(), Cells::default(), Vec::new());
        // Cells that are there and computed again, to compare: as often as answers are audited.
        let (mut checked, mut differing) = (BTreeMap::new(), Vec::new());
        let task = |cell: usize| self.task(cell);
        for cell in 0..grid.cells() {
            match self.read(cell, progress)? {
                Some((counts, by)) => {
                    landscape.add(cell, &counts);
                    cells.add(cell, by.as_ref());
                    if self.session.cluster.spot_checks(&Task::GridCell(task(cell))) {
                        checked.insert(cell, counts);
                        asked.push(cell);
                    }
                }
                None => asked.push(cell),
            }
        }
        let found = grid.cells() + checked.len() - asked.len();
        if found > 0 {
            progress.say(&format!("{found} of {} cells are there already", grid.cells()));
        }

        let tasks = asked.iter().map(|&cell| task(cell)).collect();
        let mut report = CellReport {
            done: found,
            cells: grid.cells(),
            computed: 0,
            cell_len: grid.cell_len(),
            queries: spec.queries,
            best: None,
        };
        progress.cells_start(&report);
        let take = |news: &ClusterNews, answers: Vec<CellAnswer>| {
            for answer in answers {
                let by = CountedBy::of(&answer);
                let CellAnswer { place, counts, settled, provenance, .. } = answer;
                let cell = asked[place];
                if let Some(before) = checked.get(&cell) {
                    if *before != counts {
                        differing.push((cell, provenance));
                    }
                    continue;
                }
                landscape.add(cell, &counts);
                cells.add(cell, Some(&by));
                // Written before the next is waited for: a killed search loses at most what comes in at once, and
                // what is to be audited and is not yet.
                if settled {
                    folder.write_cell(&spec.cell_name(cell), &spec.points(cell, counts, Some(by)))?;
                } else {
                    unsettled.push((cell, counts, by));
                }
                report.done += 1;
                report.computed += 1;
                report.best = landscape.leader().map(|(count, best)| (count, Descriptor::DiskRing(best)));
                progress.cell_done(&report);
            }
            // Before anything else is done: a search that is killed now must not go on with what is in doubt.
            for cell in news.doubts.iter().flat_map(|doubt| cells.doubt(doubt, grid)) {
                folder.remove_cell(&spec.cell_name(cell))?;
            }
            progress.news(news);
            Ok::<_, RunError>(())
        };
        client.evaluate_cells(tasks, take).await?;
        for (cell, provenance) in differing {
            if provenance.is_none_or(|provenance| provenance.basis < Basis::Audited) {
                return Err(RunError::WrongCell {
                    folder: folder.path().to_owned(),
                    cell: spec.cell_name(cell),
                });
            }
            let (who, gone) = cells.wrong(cell);
            for cell in gone {
                folder.remove_cell(&spec.cell_name(cell))?;
            }
            self.session.forget(&Wrong::principals(who), progress.console());
        }
        if cells.removed > 0 {
            progress.say(&format!("{} cells that were in doubt are computed again", cells.removed));
            return Ok(None);
        }
        for (cell, counts, by) in unsettled {
            folder.write_cell(&spec.cell_name(cell), &spec.points(cell, counts, Some(by)))?;
        }
        self.finish(&landscape, found, cells.provenance(), started)?;
        let (session, place) = (self.session.cluster.session, (folder.path(), true));
        finished_runs::note(&self.session.store, place, session, cells.principals(), std::iter::empty());
        Ok(Some(read_grid(folder.path())?))
    }

    /// What is asked of a cell.
    fn task(&self, cell: usize) -> GridCell {
        let (grid, splits) = (&self.spec.grid, &self.session.splits);
        let descriptors = grid.cell_len() as u32; // at most `MAX_CELL`
        splits.grid_cell(cell_subject(splits.preparation(), grid.radii(cell), descriptors), descriptors)
    }

    /// The counts of a cell that is there and sound, and who counted.
    fn read(&self, cell: usize, progress: &Progress) -> Result<Option<Counted>, RunError> {
        let name = self.spec.cell_name(cell);
        let what = match self.folder.read_cell(&name) {
            Ok(None) => return Ok(None),
            Ok(Some(mut points)) => {
                let by = points.worker_id.take().zip(points.principal.take());
                let (seconded, basis) = (points.seconded.take(), points.basis.take());
                let basis = basis.and_then(|name| basis_of(&name));
                let by = by.map(|(worker_id, principal)| CountedBy { worker_id, principal, seconded, basis });
                match self.spec.counts(cell, points) {
                    Some(counts) => return Ok(Some((counts, by))),
                    None => "it holds other descriptors".to_owned(),
                }
            }
            Err(error) if error.is_damage() => Message::of(&error).what,
            Err(error) => return Err(error.into()),
        };
        progress.say(&format!("warning: cell {name} is computed again: {what}"));
        Ok(None)
    }

    fn finish(
        &self,
        landscape: &Landscape<'_>,
        found: usize,
        provenance: Option<Provenance>,
        started: Instant,
    ) -> Result<(), RunError> {
        let GridSpec { grid, queries, train_digest, text, key } = self.spec;
        let best = landscape.best();
        // Both are there: every gene has a value, and all cells have come.
        let (Some(first), Some(digest)) = (best.first().cloned(), landscape.digest()) else { return Ok(()) };
        let grid = GridRow {
            name: self.name.to_owned(),
            grid_key: key.to_string(),
            search_space: text.clone(),
            train_digest: train_digest.clone(),
            evaluation_version: EVALUATION_VERSION,
            cells: grid.cells() as u32,
            descriptors: grid.descriptors(),
            queries: *queries,
            optimal_descriptors: landscape.optimal_descriptors(),
            best_genes: first.genes,
            best_object_correct: first.object_correct,
            grid_digest: digest.to_hex().to_string(),
            cells_computed: (grid.cells() - found) as u32,
            cells_found: found as u32,
            run: provenance.is_some().then(|| self.session.cluster.session.to_string()),
            principals: provenance.as_ref().map(|one| principals_text(&one.principals)),
            basis: provenance.map(|one| basis_name(one.basis).to_owned()),
            seconds: started.elapsed().as_secs_f64(),
            finished_at: SystemTime::now(),
        };
        self.folder.write_tables(&GridTables {
            grid,
            best,
            marginals: landscape.marginals(),
            landscapes: landscape.landscapes(),
            counts: landscape.counts(),
        })?;
        Ok(())
    }
}
