//! Reports of runs, sweeps and grids: one HTML page, and each of its figures as files.
//!
//! Tables are read in `data.rs`; `figures/` makes figures of them, `figure.rs` says what a figure is; `draw/` draws it,
//! `run_page.rs` and its neighbours say what stands on a page, `html.rs` lays it out.

mod address;
mod data;
mod descriptor_tables;
mod draw;
mod escape;
mod figure;
mod figures;
mod grid_page;
mod html;
mod latex;
mod numbers;
mod palette;
mod run_page;
mod run_tables;
mod runs;
mod runs_page;
mod summary;
mod table;
mod thin;
mod told;
mod wrong;

use std::borrow::Cow;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

use data::{Rows, RunData};
pub use figures::channels::{ChannelPairs, WinnerChannel};
pub use figures::on_cloud::{SeenChannel, SeenCloud, SeenPairs, SeenRegion};
use html::Page;
pub use runs::NamedRun;
use runs::Runs;
pub use told::Told;
pub use wrong::{ShownCloud, WrongClouds, cloud_bytes};

use crate::error::Error;
use crate::file::write_whole;
use crate::table_name::TableName;

/// The script that shows point clouds: a module without imports, which pages have as a file or in their text.
pub const CLOUD_VIEWER: &str = html::VIEWER;

/// Name and content of a file, and how to tell that an earlier one of this name is ours.
type File = (String, Vec<u8>, fn(&str) -> bool);

/// A report that is ready to be written. Equal tables give equal bytes.
#[derive(Clone, Debug)]
pub struct Report {
    page: Page,
    /// The paper's Table 1, if descriptors were compared.
    table1: Option<String>,
    /// What the page says to type, under the names that programs have where it is read.
    named: fn(&str) -> Cow<'_, str>,
}

impl Report {
    fn new(page: Page, table1: Option<String>) -> Self {
        Self { page, table1, named: |text| Cow::Borrowed(text) }
    }

    /// The same report, its page as HTML changed by `named`: texts name programs as they are built, and may be read where
    /// these have other names.
    pub fn with_names(self, named: fn(&str) -> Cow<'_, str>) -> Self {
        Self { named, ..self }
    }

    /// The report of one run, finished or not. `grid`: the folder of an exhaustive search, whose exact marginals are
    /// drawn beside those of the run. `told`: what tables do not say.
    ///
    /// # Errors
    /// If it is not a run folder, or if a file in it cannot be read or is damaged; the message names the file.
    pub fn of_run(folder: impl AsRef<Path>, grid: Option<&Path>, told: &Told) -> Result<Self, Error> {
        let folder = folder.as_ref();
        let data = RunData::read(folder, &label(folder))?;
        let grid = match grid {
            None => None,
            Some(grid) => {
                let folder = grid.join(TableName::Marginals.as_str());
                let missing = Error::NoFiles { folder, table: TableName::Marginals };
                Some(Rows::read(grid, TableName::Marginals)?.ok_or(missing)?)
            }
        };
        let table1 =
            data.comparison.as_ref().map(|comparison| latex::table1(&comparison.descriptors)).transpose()?;
        Ok(Self::new(run_page::page(&data, grid.as_ref(), told)?, table1))
    }

    /// The report of several runs: what they reached, over seeds and compared with each other. A run that is named twice,
    /// or is the same as another, counts once. `verdict`: what seeds say together, in sentences. `page`: where the page
    /// will be, from which it leads to the reports of the runs that have one.
    ///
    /// # Errors
    /// As [`Report::of_run`].
    pub fn of_runs(title: &str, runs: &[NamedRun], verdict: &[String], page: &Path) -> Result<Self, Error> {
        Ok(Self::new(runs_page::page(title, &Runs::read(runs, page)?, verdict), None))
    }

    /// The report of an exhaustive search: the best descriptors, how rare they are, and how errors depend on genes.
    ///
    /// # Errors
    /// If the grid is not whole, or if a file in it cannot be read or is damaged; the message names the file.
    pub fn of_grid(folder: impl AsRef<Path>) -> Result<Self, Error> {
        Ok(Self::new(grid_page::page(folder.as_ref())?, None))
    }

    /// The page.
    ///
    /// # Errors
    /// If a figure cannot be drawn.
    pub fn html(&self) -> Result<String, Error> {
        Ok((self.named)(&self.page.html()?).into_owned())
    }

    /// Name and content of each figure's SVG file.
    ///
    /// # Errors
    /// If a figure cannot be drawn.
    pub fn svgs(&self) -> Result<Vec<(String, String)>, Error> {
        let file = |figure: &figure::Figure| Ok((format!("{}.svg", figure.id), draw::svg(figure)?));
        self.page.figures().map(file).collect()
    }

    /// Writes each figure as SVG and PDF into the folder `to`, which is made, and the comparison as LaTeX, if there is one.
    /// Gives the files.
    ///
    /// # Errors
    /// As [`Report::write`].
    pub fn write_figures(&self, to: &Path) -> Result<Vec<PathBuf>, Error> {
        let mut files: Vec<File> = Vec::new();
        for (name, content) in self.svgs()? {
            files.push((name, content.into_bytes(), draw::begins_svg));
        }
        for figure in self.page.figures() {
            files.push((format!("{}.pdf", figure.id), draw::pdf(figure)?, draw::begins_pdf));
        }
        if let Some(table) = &self.table1 {
            files.push((latex::FILE.to_owned(), table.clone().into_bytes(), latex::begins_table));
        }
        for (name, _, is_ours) in &files {
            refuse_foreign(&to.join(name), is_ours)?;
        }
        fs::create_dir_all(to).map_err(|source| Error::io(to, "make this folder", source))?;
        let write = |(name, content, _): File| {
            let file = to.join(name);
            write_whole(&file, &content)?;
            Ok(file)
        };
        files.into_iter().map(write).collect()
    }

    /// Writes the page to `html` and the figures into the folder `svg`, which are made. Gives the figures' files.
    ///
    /// # Errors
    /// If a figure cannot be drawn or a file cannot be written, or if one of these names is taken by a file that no report
    /// has written: then nothing is.
    pub fn write(&self, html: &Path, svg: &Path) -> Result<Vec<PathBuf>, Error> {
        let (page, svgs) = (self.html()?, self.svgs()?);
        refuse_foreign(html, html::begins_page)?;
        for (name, _) in &svgs {
            refuse_foreign(&svg.join(name), draw::begins_svg)?;
        }
        let parent = html.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        for folder in [parent, svg] {
            fs::create_dir_all(folder).map_err(|source| Error::io(folder, "make this folder", source))?;
        }
        let mut files = Vec::new();
        for (name, content) in svgs {
            let file = svg.join(name);
            write_whole(&file, content.as_bytes())?;
            files.push(file);
        }
        write_whole(html, page.as_bytes())?;
        Ok(files)
    }
}

/// What a folder is called.
fn label(folder: &Path) -> String {
    let folder = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    folder.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Refuses to replace a file that does not begin as this program's do; an empty one is nobody's loss.
fn refuse_foreign(file: &Path, is_ours: impl Fn(&str) -> bool) -> Result<(), Error> {
    let failed = |source| Error::io(file, "read this file", source);
    match fs::metadata(file) {
        Ok(metadata) if metadata.is_file() => {}
        Ok(_) => return Err(Error::Occupied(file.to_owned())), // a pipe would be waited for
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(source) => return Err(failed(source)),
    }
    let mut held = Vec::new();
    fs::File::open(file).and_then(|file| file.take(256).read_to_end(&mut held)).map_err(failed)?;
    let held = String::from_utf8_lossy(&held);
    if held.is_empty() || is_ours(&held) { Ok(()) } else { Err(Error::Occupied(file.to_owned())) }
}
