//! Samples, rows and the table of all rows.

use std::fmt;

/// Repeated measurements of one thing, seconds.
#[derive(Clone, Debug, Default)]
pub struct Samples(Vec<f64>);

impl Samples {
    /// Adds a measurement.
    pub fn push(&mut self, seconds: f64) {
        self.0.push(seconds);
    }

    /// The middle one; of an even number the mean of the two in the middle.
    pub fn median(&self) -> f64 {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted.len() / 2;
        if sorted.len() % 2 == 1 { sorted[middle] } else { (sorted[middle - 1] + sorted[middle]) / 2.0 }
    }
}

impl FromIterator<f64> for Samples {
    fn from_iter<I: IntoIterator<Item = f64>>(seconds: I) -> Self {
        Self(seconds.into_iter().collect())
    }
}

impl fmt::Display for Samples {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let extreme = |pick: fn(f64, f64) -> f64| self.0.iter().copied().reduce(pick).unwrap_or(f64::NAN);
        let (low, high) = (extreme(f64::min), extreme(f64::max));
        write!(f, "{} (median of {}, {} to {})", time(self.median()), self.0.len(), time(low), time(high))
    }
}

/// What PCL's user pays for the same.
#[derive(Clone, Copy, Debug)]
pub struct Anchors {
    /// From scratch, seconds.
    pub scratch: f64,
    /// With the normals of all clouds kept from before, seconds.
    pub cached: f64,
}

/// One row.
#[derive(Debug)]
pub struct Row {
    /// Its name on the command line.
    pub name: &'static str,
    /// What was measured.
    pub what: String,
    /// Our time.
    pub own: Samples,
    /// PCL's, if there is such a thing and PCL is there.
    pub peer: Option<Anchors>,
    /// What else is to be said.
    pub notes: Vec<String>,
}

/// All rows so far.
#[derive(Debug, Default)]
pub struct Table(Vec<Row>);

impl Table {
    /// Adds a row and prints it: the next one may take minutes.
    pub fn add(&mut self, row: Row) {
        println!("\n{}: {}\n    {}", row.name, row.what, row.own);
        if let Some(peer) = row.peer {
            let own = row.own.median();
            let [scratch, cached] =
                [peer.scratch, peer.cached].map(|peer| format!("{}: {}", time(peer), ratio(own, peer)));
            println!("    PCL {scratch}; with the normals cached {cached}");
        }
        for note in &row.notes {
            println!("    {note}");
        }
        self.0.push(row);
    }
}

impl fmt::Display for Table {
    /// Markdown, as it stands in this folder's README.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "| row | what | Descry | PCL | ratio | PCL, normals cached | ratio |")?;
        writeln!(f, "|---|---|---|---|---|---|---|")?;
        for Row { name, what, own, peer, .. } in &self.0 {
            let own = own.median();
            let anchor = |seconds: f64| format!("{} | {}", time(seconds), ratio(own, seconds));
            let peer = peer.map_or("– | – | – | –".to_owned(), |peer| {
                format!("{} | {}", anchor(peer.scratch), anchor(peer.cached))
            });
            writeln!(f, "| `{name}` | {what} | {} | {peer} |", time(own))?;
        }
        Ok(())
    }
}

/// Our share of the peer's time.
fn ratio(own: f64, peer: f64) -> String {
    let times = peer / own;
    if times < 100.0 { format!("1/{times:.1}") } else { format!("1/{times:.0}") }
}

/// Seconds with three digits and a unit that suits them.
pub fn time(seconds: f64) -> String {
    match seconds {
        7200.0.. => format!("{:.1} h", seconds / 3600.0),
        100.0.. => format!("{seconds:.0} s"),
        1.0.. => format!("{seconds:.2} s"),
        0.1.. => format!("{:.0} ms", seconds * 1e3),
        0.001.. => format!("{:.2} ms", seconds * 1e3),
        _ => format!("{:.0} µs", seconds * 1e6),
    }
}

/// Bytes in MB.
pub fn megabytes(bytes: u64) -> String {
    format!("{:.0} MB", bytes as f64 / 1e6)
}
