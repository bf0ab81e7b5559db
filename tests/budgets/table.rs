//! The table of compiler statistics of kernels: a file GPU.csv per GPU in this folder, with a row per pipeline; and the
//! allowed changes.

use crate::statistics::full_occupancy;
use std::path::PathBuf;

/// Figures of a pipeline; `None` if a GPU's driver does not report them. `statistics.rs` has the units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Static count: a loop counts once.
    pub instructions: f64,
    /// Registers per lane.
    pub registers: Option<f64>,
    /// Waves, threads or lanes that run at once, limited by registers.
    pub occupancy: f64,
    /// Stores and loads of spilled registers.
    pub spills: f64,
    /// Memory per lane, mostly arrays.
    pub scratch: f64,
    /// Cycles of the limiting unit.
    pub cycles: Option<f64>,
    /// Cycles from start to end, or spent waiting.
    pub latency: Option<f64>,
}

/// A pipeline on a GPU.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The module's name under spirv/.
    pub kernel: String,
    /// Specialization constants by name.
    pub constants: String,
    pub figures: Figures,
    /// The reason for a shortfall.
    pub why: String,
}

const COLUMNS: &str = "constants,instructions,registers,occupancy,spills,scratch,cycles,latency,why";
/// Prefix of a reason that is still to be given.
const ASKED: &str = "? ";

pub fn file(gpu: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "tests", "budgets", &format!("{gpu}.csv")].iter().collect()
}

impl Row {
    pub fn name(&self) -> String {
        let space = if self.constants.is_empty() { "" } else { " " };
        format!("{}{space}{}", self.kernel, self.constants)
    }

    /// Returns whether it should have the GPU's full occupancy. A tile of several instances, or a batch of several
    /// targets, keeps more numbers in registers, in exchange for fewer loads.
    fn is_single(&self) -> bool {
        let mut words = self.constants.split(' ').skip_while(|word| !["HEADS", "BATCH"].contains(word)).skip(1);
        words.next().is_none_or(|many| many == "0" || many == "1")
    }

    /// Returns whether it keeps in memory what should be in registers.
    pub fn spills(&self) -> bool {
        self.figures.spills > 0.0 || self.figures.scratch > 0.0
    }

    /// Returns whether it needs a reason.
    fn falls_short(&self, gpu: &str) -> bool {
        self.spills() || self.is_single() && self.figures.occupancy < full_occupancy(gpu)
    }

    /// Describes regressions since `old`; empty if there are none. Driver versions count occupancy differently.
    fn worse_than(&self, old: &Self, gpu: &str, same_driver: bool) -> String {
        let (now, was, full) = (&self.figures, &old.figures, full_occupancy(gpu));
        let mut worse = vec![];
        if same_driver && now.occupancy < was.occupancy.min(full) {
            worse.push(format!("occupancy {}, was {}", now.occupancy, was.occupancy));
        }
        if now.spills > was.spills {
            worse.push(format!("spills {}, was {}", now.spills, was.spills));
        }
        if now.scratch > was.scratch {
            worse.push(format!("scratch {}, was {}", now.scratch, was.scratch));
        }
        worse.join("; ")
    }

    fn line(&self) -> String {
        let why = if self.why.is_empty() { String::new() } else { format!("\"{}\"", self.why) };
        format!("{},{why}", self.line_without_reason())
    }

    fn line_without_reason(&self) -> String {
        let Figures { instructions, registers, occupancy, spills, scratch, cycles, latency } = self.figures;
        let cell = |figure: Option<f64>| figure.map(|figure| format!("{figure:.5}")).unwrap_or_default();
        let figures = [Some(instructions), registers, Some(occupancy), Some(spills), Some(scratch), cycles, latency];
        let figures = figures.map(|figure| match cell(figure) {
            text if text.contains('.') => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
            text => text,
        });
        format!("{},{},{}", self.kernel, self.constants, figures.join(","))
    }

    fn of_line(line: &str) -> Option<Self> {
        let mut cells = line.splitn(1 + COLUMNS.split(',').count(), ',');
        let mut text = || cells.next().map(str::to_owned);
        let (kernel, constants) = (text()?, text()?);
        let mut number = || text().and_then(|cell| cell.parse().ok());
        let (instructions, registers, occupancy, spills, scratch) =
            (number()?, number(), number()?, number()?, number()?);
        let (cycles, latency) = (number(), number());
        let figures = Figures { instructions, registers, occupancy, spills, scratch, cycles, latency };
        Some(Self { kernel, constants, figures, why: text()?.trim_matches('"').to_owned() })
    }
}

/// The statistics of a GPU.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    pub gpu: String,
    /// The driver's version.
    pub driver: String,
    pub rows: Vec<Row>,
}

impl Table {
    /// Reads the checked-in table; empty if there is no file.
    pub fn read(gpu: &str) -> Self {
        let mut table = Self { gpu: gpu.to_owned(), driver: String::new(), rows: vec![] };
        let path = file(gpu);
        let Ok(text) = std::fs::read_to_string(&path) else { return table };
        let mut lines = text.lines();
        let driver = |head: &str| Some(head.strip_prefix("kernel (driver ")?.split_once("),")?.0.to_owned());
        table.driver = lines.next().and_then(driver).unwrap_or_else(|| panic!("{}: no head", path.display()));
        let row = |line| Row::of_line(line).unwrap_or_else(|| panic!("{}: no row: '{line}'", path.display()));
        table.rows = lines.map(row).collect();
        table
    }

    pub fn write(&self) {
        let lines = self.rows.iter().map(|row| row.line() + "\n");
        let text = format!("kernel (driver {}),{COLUMNS}\n{}", self.driver, lines.collect::<String>());
        let path = file(&self.gpu);
        std::fs::write(&path, text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    }

    fn row(&self, like: &Row) -> Option<&Row> {
        self.rows.iter().find(|row| row.kernel == like.kernel && row.constants == like.constants)
    }

    /// Returns this table with the reasons of `old` that are still needed; regressions without one are marked.
    pub fn with_reasons(mut self, old: &Self) -> Self {
        for i in 0..self.rows.len() {
            let Some(was) = old.row(&self.rows[i]) else { continue };
            let (gpu, same_driver) = (&self.gpu, self.driver == old.driver);
            let (worse, reason) = (self.rows[i].worse_than(was, gpu, same_driver), was.why.trim_start_matches(ASKED));
            let row = &mut self.rows[i];
            if !worse.is_empty() {
                row.why = format!("{ASKED}{worse}; {reason}").trim_end_matches("; ").to_owned();
            } else if row.spills() || row.figures.occupancy < full_occupancy(&self.gpu) {
                row.why.clone_from(&was.why);
            }
        }
        self
    }

    /// Returns the violations of `budget`, one per line. For another driver version only spills and memory are
    /// compared, since the other figures differ between versions.
    pub fn breaches(&self, budget: &Self) -> Vec<String> {
        let (gpu, same_driver) = (&self.gpu, self.driver == budget.driver);
        let (mut breaches, mut stale) = (vec![], vec![]);
        for row in &self.rows {
            let Some(was) = budget.row(row) else {
                breaches.push(format!("{} on {gpu}: not in the table", row.name()));
                continue;
            };
            let worse = row.worse_than(was, gpu, same_driver);
            if !worse.is_empty() {
                breaches.push(format!("{} on {gpu}: {worse}", row.name()));
            } else if same_driver && row.line_without_reason() != was.line_without_reason() {
                stale.push(row.name());
            }
        }
        if let Some(first) = stale.first() {
            breaches.push(format!("{first} on {gpu}: no worse, but the table is out of date, in {} rows", stale.len()));
        }
        let gone = budget.rows.iter().filter(|row| self.row(row).is_none());
        breaches.extend(gone.map(|row| format!("{} on {gpu}: in the table, but nobody makes it", row.name())));
        breaches
    }

    /// Returns the rows that fall short without a reason, one per line.
    pub fn unexplained(&self) -> Vec<String> {
        let gpu = &self.gpu;
        let open = |row: &&Row| row.why.starts_with(ASKED) || row.why.is_empty() && row.falls_short(gpu);
        let line = |row: &Row| {
            let Figures { occupancy, spills, scratch, .. } = row.figures;
            let full = full_occupancy(gpu);
            format!("{} on {gpu}: occupancy {occupancy} of {full}, spills {spills}, scratch {scratch}", row.name())
        };
        self.rows.iter().filter(open).map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(lines: &[&str]) -> Table {
        let rows = lines.iter().map(|line| Row::of_line(line).expect("a row")).collect();
        Table { gpu: "mali-g52".into(), driver: "1.2.3".into(), rows }
    }

    #[test]
    fn rows_are_read_as_they_are_written() {
        for line in ["crowd,HEADS 2,310,,1,2,3,51.25,,\"half of the threads, for now\"", "plan,,10,12,2,0,0,,5.5,"] {
            assert_eq!(Row::of_line(line).expect("a row").line(), line);
        }
        assert_eq!(Row::of_line("crowd,HEADS 2,many,,1,2,3,51.25,,"), None);
    }

    #[test]
    fn what_is_worse_is_a_breach_until_the_table_says_why() {
        let budget = table(&["crowd,HEADS 1,300,,2,0,0,51,,", "plan,,10,,2,0,0,9,,"]);
        assert_eq!(budget.breaches(&budget), <[&str; 0]>::default());
        for (line, said) in [
            ("crowd,HEADS 1,300,,1,0,0,51,,", "occupancy 1, was 2"),
            ("crowd,HEADS 1,300,,2,4,0,51,,", "spills 4, was 0"),
            ("crowd,HEADS 1,300,,2,0,8,51,,", "scratch 8, was 0"),
        ] {
            let now = table(&[line, "plan,,10,,2,0,0,9,,"]);
            assert_eq!(now.breaches(&budget), [format!("crowd HEADS 1 on mali-g52: {said}")]);
            // A missing reason is marked; a given one stays as long as it is needed.
            let mut taken = now.clone().with_reasons(&budget);
            assert_eq!((taken.breaches(&taken).len(), taken.unexplained().len()), (0, 1));
            assert_eq!(taken.rows[0].why, format!("? {said}"));
            taken.rows[0].why = "needed".into();
            let again = now.with_reasons(&taken);
            assert_eq!((again.unexplained().len(), again.rows[0].why.as_str()), (0, "needed"));
            assert_eq!(budget.clone().with_reasons(&again).rows[0].why, "");
        }
    }

    #[test]
    fn a_new_kernel_needs_a_reason_too() {
        let now =
            table(&["crowd,HEADS 1,300,,1,0,0,51,,", "crowd,HEADS 2,300,,1,0,0,51,,", "crowd,HEADS 4,300,,1,0,1,51,,"]);
        let unexplained = now.unexplained();
        assert!(unexplained[0].starts_with("crowd HEADS 1 on mali-g52: occupancy 1 of 2"), "{unexplained:?}");
        // Tiles may use more registers, but nothing else.
        assert!(unexplained[1].starts_with("crowd HEADS 4"), "{unexplained:?}");
        assert_eq!(unexplained.len(), 2);
        assert_eq!(now.breaches(&table(&[])).len(), 3);
    }

    #[test]
    fn a_table_that_is_out_of_date_is_a_breach_with_the_same_driver_alone() {
        let budget = table(&["crowd,HEADS 1,300,,1,0,0,51,,", "gone,,10,,2,0,0,9,,"]);
        let mut now = table(&["crowd,HEADS 1,290,,2,0,0,51,,"]);
        let breaches = now.breaches(&budget);
        assert!(breaches[0].contains("out of date, in 1 rows"), "{breaches:?}");
        assert_eq!(breaches[1], "gone on mali-g52: in the table, but nobody makes it");
        now.driver = "2.0.0".into();
        assert_eq!(now.breaches(&budget).len(), 1);
        now.rows[0].figures.spills = 1.0;
        assert_eq!(now.breaches(&budget)[0], "crowd HEADS 1 on mali-g52: spills 1, was 0");
    }
}
