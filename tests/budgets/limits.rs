//! limits.csv: what every pipeline has to keep on each GPU. A pipeline without a row has full occupancy and keeps
//! nothing in memory; rows name the families of kernels that may have less, and why.

use super::statistics::Figures;
use std::collections::BTreeSet;

/// A pipeline on a GPU.
pub struct Row {
    /// The module's name under spirv/.
    pub kernel: String,
    /// Specialization constants by name.
    pub constants: String,
    pub figures: Figures,
}

impl Row {
    /// Returns the kernel, without the pose format, and how many instances, targets or joints it takes at once.
    pub fn family(&self) -> String {
        let kernel = ["_fixed16", "_fixed32"].iter().find_map(|pose| self.kernel.strip_suffix(pose));
        let mut family = kernel.unwrap_or(&self.kernel).to_owned();
        let words: Vec<&str> = self.constants.split(' ').collect();
        for pair in words.windows(2).filter(|pair| ["INSTANCES", "BATCH", "INFLUENCES"].contains(&pair[0])) {
            family += &format!(" {} {}", pair[0], pair[1]);
        }
        family
    }
}

/// The statistics of a GPU.
pub struct Table {
    pub gpu: String,
    /// The driver's version.
    pub driver: String,
    pub rows: Vec<Row>,
}

/// The file: a column for each GPU, and a row for each limit.
pub struct Limits {
    gpus: Vec<String>,
    rows: Vec<(String, Vec<String>)>,
}

impl Limits {
    pub fn read() -> Self {
        let mut rows = include_str!("limits.csv").lines().map(|line| {
            let mut cells = line.split(',').map(str::to_owned);
            let name = cells.next().expect("a name");
            (name, cells.collect::<Vec<_>>())
        });
        let (_, gpus) = rows.next().expect("a header");
        let rows: Vec<_> = rows.collect();
        for (name, cells) in &rows {
            assert_eq!(cells.len(), gpus.len(), "limits.csv: {name}");
            assert!(cells.last().is_some_and(|why| !why.is_empty()), "limits.csv: {name} does not say why");
        }
        Self { gpus, rows }
    }

    fn cell(&self, gpu: &str, name: &str) -> Option<&str> {
        let column = self.gpus.iter().position(|known| known == gpu);
        let column = column.unwrap_or_else(|| panic!("limits.csv has no column {gpu}"));
        let (_, cells) = self.rows.iter().find(|(row, _)| row == name)?;
        Some(cells[column].as_str()).filter(|cell| !cell.is_empty())
    }

    fn number(&self, gpu: &str, name: &str) -> Option<f64> {
        self.cell(gpu, name).map(|cell| cell.parse().unwrap_or_else(|e| panic!("limits.csv: {name}, {gpu}: {e}")))
    }

    /// Returns what is below its limit, one pipeline a line. Versions of a driver count occupancy differently: it is
    /// compared for the version of the file alone.
    pub fn breaches(&self, table: &Table) -> Vec<String> {
        let gpu = &table.gpu;
        let same_driver = self.cell(gpu, "driver") == Some(&table.driver);
        let full = self.number(gpu, "full").expect("full occupancy");
        let mut breaches = vec![];
        for row in &table.rows {
            let (family, figures) = (row.family(), &row.figures);
            let occupancy = self.number(gpu, &format!("occupancy {family}")).unwrap_or(full);
            let memory = self.number(gpu, &format!("memory {family}")).unwrap_or(0.0);
            let mut say = |what: &str, has: f64, limit: f64| {
                breaches.push(format!("{} {} on {gpu}: {what} {has}, limit {limit}", row.kernel, row.constants));
            };
            if same_driver && figures.occupancy < occupancy {
                say("occupancy", figures.occupancy, occupancy);
            }
            if figures.spills > 0.0 {
                say("spills", figures.spills, 0.0);
            }
            if figures.scratch > memory {
                say("memory", figures.scratch, memory);
            }
        }
        breaches
    }

    /// Returns the limits of families that are not in `made`.
    pub fn without_kernel(&self, made: &BTreeSet<String>) -> Vec<&str> {
        let families = self.rows.iter().filter_map(|(name, _)| name.split_once(' '));
        families.map(|(_, family)| family).filter(|family| !made.contains(*family)).collect()
    }
}
