//! Runs of a program with failing calls.

use crate::calls::errors;
use crate::enable;
use ash::vk;
use std::collections::BTreeMap;
use std::fs::{File, read_dir};
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Longest time of a run; after that it counts as hanging.
const MOST: Duration = Duration::from_secs(300);

/// A failing call: the `at`th of its name.
#[derive(Clone, Debug)]
pub struct Fault {
    /// The call.
    pub call: String,
    /// Its number, from 1.
    pub at: usize,
    /// Its result.
    pub error: vk::Result,
}

/// The result of a run.
pub struct Run {
    /// `None`: it was killed after a timeout.
    pub status: Option<ExitStatus>,
    /// Its stderr.
    pub said: String,
    /// Its output: the files in its folder, without those of the run itself.
    pub files: BTreeMap<String, Vec<u8>>,
    log: String,
}

impl Run {
    /// Runs `command`, made for an empty folder of its own, with the layer, and with `fault`, if any.
    pub fn new(folder: &Path, command: impl FnOnce(&Path) -> Command, fault: Option<&Fault>) -> Self {
        let (own, log, said) = (folder.join("own"), folder.join("log"), folder.join("said"));
        std::fs::create_dir_all(&own).expect("a folder");
        let mut command = command(&own);
        enable(&mut command, folder).env("DELTAMORPH_FAIL_LOG", &log).env("RUST_BACKTRACE", "0");
        if let Some(Fault { call, at, error }) = fault {
            command.env("DELTAMORPH_FAIL", format!("{call}:{at}:{}", error.as_raw()));
        }
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(File::create(&said).expect("a file"));
        let (mut child, start) = (command.spawn().unwrap_or_else(|e| panic!("{command:?}: {e}")), Instant::now());
        let status = loop {
            match child.try_wait().expect("a child") {
                Some(status) => break Some(status),
                None if start.elapsed() > MOST => {
                    child.kill().expect("a child");
                    child.wait().expect("a child");
                    break None;
                }
                None => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        let files = read_dir(&own).expect("a folder").map(|entry| entry.expect("a file").path());
        let files = files.filter(|path| path.is_file()).map(|path| {
            let name = path.file_name().expect("a name").to_string_lossy().into_owned();
            (name, std::fs::read(path).expect("a file"))
        });
        let text = |path| String::from_utf8_lossy(&std::fs::read(path).unwrap_or_default()).into_owned();
        let run = Self { status, said: text(&said), files: files.collect(), log: text(&log) };
        std::fs::remove_dir_all(own).expect("a folder");
        std::fs::remove_file(log).expect("the layer's log: was it loaded?");
        run
    }

    fn lines<'a>(&'a self, first: &'a str) -> impl Iterator<Item = &'a str> {
        self.log.lines().filter_map(move |line| line.strip_prefix(first)?.strip_prefix(' '))
    }

    /// Returns whether the planned call failed.
    pub fn failed(&self) -> bool {
        self.lines("FAILED").next().is_some()
    }

    /// Returns a defect that no run may have, whatever fails.
    pub fn defect(&self) -> Option<&'static str> {
        match self.status {
            None => Some("hangs"),
            Some(status) if status.code().is_none() => Some("crashes"),
            _ if self.said.contains("panicked") => Some("panics"),
            _ if self.lines("UNKNOWN").next().is_some() => Some("destroys twice"),
            _ if self.lines("LEAKED").next().is_some() => Some("leaks"),
            _ => None,
        }
    }

    /// Returns the number of instances and devices that were not destroyed.
    pub fn left(&self) -> usize {
        self.lines("MADE").count() - self.lines("UNMADE").count()
    }

    /// Returns calls by call site, the first and the last of each: name, and number among the calls of this name.
    pub fn places(&self) -> Vec<(String, usize)> {
        let (mut named, mut at) = (BTreeMap::<&str, usize>::new(), BTreeMap::<(&str, &str), [usize; 2]>::new());
        for (call, place) in self.lines("CALL").filter_map(|line| line.split_once(' ')) {
            let count = named.entry(call).or_default();
            *count += 1;
            at.entry((call, place)).or_insert([*count; 2])[1] = *count;
        }
        let mut all: Vec<_> = at.iter().flat_map(|((call, _), ends)| ends.map(|at| ((*call).to_owned(), at))).collect();
        all.sort_unstable();
        all.dedup();
        all
    }
}

/// Returns each of these calls with each error that it may return.
pub fn faults(places: &[(String, usize)]) -> Vec<Fault> {
    let each = |(call, at): &(String, usize)| {
        let (call, at) = (call.clone(), *at);
        errors(&call).iter().map(move |&error| Fault { call: call.clone(), at, error }).collect::<Vec<_>>()
    };
    places.iter().flat_map(each).collect()
}
