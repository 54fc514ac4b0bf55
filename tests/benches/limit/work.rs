//! What stages consist of, and how long it takes at the rates of the processor.

use std::fmt;

/// What a stage has to do many times. Each has a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    File,
    FileByte,
    CopiedByte,
    Feature,
    Key,
    Distance,
    DotProduct,
    Neighbour,
    Root,
    FewBins,
    ManyBins,
    Share,
    Value,
    Term,
    Fetch,
    MemoryByte,
}

impl Element {
    /// All of them, in the order in which they are declared.
    pub const ALL: [Self; 16] = [
        Self::File,
        Self::FileByte,
        Self::CopiedByte,
        Self::Feature,
        Self::Key,
        Self::Distance,
        Self::DotProduct,
        Self::Neighbour,
        Self::Root,
        Self::FewBins,
        Self::ManyBins,
        Self::Share,
        Self::Value,
        Self::Term,
        Self::Fetch,
        Self::MemoryByte,
    ];

    /// Its name in the table of rates, and in that of stages.
    pub fn names(self) -> [&'static str; 2] {
        match self {
            Self::File => ["file opened, its length asked for", "files opened"],
            Self::FileByte => ["byte read from a file in the system's cache", "bytes of files"],
            Self::CopiedByte => ["byte copied in the first cache", "bytes of points"],
            Self::Feature => ["bin of a difference of two f32", "bins of values"],
            Self::Key => ["u64 key sorted, in arrays of 53", "keys sorted"],
            Self::Distance => ["squared distance, compared with a limit", "distances"],
            Self::DotProduct => ["dot product of two vectors", "dot products"],
            Self::Neighbour => {
                ["squared distance, compared, and nine sums of offsets", "distances with sums"]
            }
            Self::Root => ["division and square root in f64", "divisions with a root"],
            Self::FewBins => ["increment of one of 64 bins, half of them of the same", "increments"],
            Self::ManyBins => ["increment of one of 1024 bins", "increments of more than 64 bins"],
            Self::Share => ["division of a count in f32", "divisions"],
            Self::Value => ["value of a row in mean and deviation", "values of rows"],
            Self::Term => ["χ² term, two a division", "χ² terms"],
            Self::Fetch => ["point of 32 bytes fetched by its index, of 1660", "points fetched"],
            Self::MemoryByte => ["byte read from memory", "bytes from memory"],
        }
    }
}

/// Elements a second, in the order of [`Element::ALL`].
#[derive(Clone, Copy, Debug)]
pub struct Rates(pub [f64; Element::ALL.len()]);

impl Rates {
    /// Of one element.
    pub fn of(&self, element: Element) -> f64 {
        self.0[element as usize]
    }
}

/// What a stage has to do.
#[derive(Clone, Debug, Default)]
pub struct Work {
    /// What it is given.
    given: Vec<(u64, &'static str)>,
    elements: Vec<(u64, Element)>,
}

impl Work {
    /// Nothing yet, for what is given.
    pub fn given<const N: usize>(given: [(u64, &'static str); N]) -> Self {
        Self { given: given.to_vec(), elements: Vec::new() }
    }

    /// Moreover so many of an element.
    pub fn and(mut self, count: u64, element: Element) -> Self {
        self.elements.push((count, element));
        self
    }

    /// Moreover increments of histograms with so many bins.
    pub fn and_increments(self, count: u64, bins: u64) -> Self {
        self.and(count, if bins <= 64 { Element::FewBins } else { Element::ManyBins })
    }

    /// Moreover rows that become shares, then mean and deviation.
    pub fn and_rows(self, rows: u64, width: u64) -> Self {
        self.and(rows * width, Element::Share).and(rows * width, Element::Value)
    }

    /// Least seconds it can take: arithmetic one after the other, and memory beside it.
    pub fn limit(&self, rates: &Rates) -> f64 {
        let seconds = |is_memory: bool| -> f64 {
            let of_kind =
                self.elements.iter().filter(|(_, element)| (*element == Element::MemoryByte) == is_memory);
            of_kind.map(|&(count, element)| count as f64 / rates.of(element)).sum()
        };
        seconds(false).max(seconds(true))
    }
}

impl fmt::Display for Work {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let given = self.given.iter().map(|&(count, what)| format!("{} {what}", whole(count)));
        let elements = self.elements.iter().filter(|(count, _)| *count > 0);
        let elements = elements.map(|&(count, element)| format!("{} {}", amount(count), element.names()[1]));
        let [given, elements] = [given.collect::<Vec<_>>(), elements.collect()].map(|list| list.join(", "));
        write!(f, "{given}: {elements}")
    }
}

/// A whole number with its digits in threes.
fn whole(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

/// Three digits of a number.
pub fn amount(count: u64) -> String {
    let (unit, name) = match count {
        0..10_000 => return whole(count),
        10_000..1_000_000 => (1e3, "k"),
        1_000_000..1_000_000_000 => (1e6, "M"),
        _ => (1e9, "G"),
    };
    let scaled = count as f64 / unit;
    let digits = if scaled < 10.0 { 2 } else { usize::from(scaled < 100.0) };
    format!("{scaled:.digits$} {name}")
}
