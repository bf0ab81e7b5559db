//! Tickets of updates: numbers in C, values in Rust.

use crate::result::{Failure, Result};
use deltamorph::Ticket;
use std::collections::VecDeque;

/// The number of latest updates of a crowd that can still be discarded: more than a host has in flight.
const KEPT: usize = 1024;

/// Tickets of the latest updates, by number.
#[derive(Default)]
pub struct Tickets {
    recorded: u64,
    kept: VecDeque<Ticket>,
}

impl Tickets {
    /// Keeps the ticket of the next update, and returns its number.
    pub fn push(&mut self, ticket: Ticket) -> u64 {
        self.recorded += 1;
        self.kept.push_back(ticket);
        if self.kept.len() > KEPT {
            self.kept.pop_front();
        }
        self.recorded
    }

    /// Finds the ticket with this number.
    pub fn find(&self, number: u64) -> Result<Ticket> {
        let age = self.recorded.checked_sub(number).filter(|_| number > 0).ok_or_else(|| {
            Failure::invalid(format!("update {number} of {}; hand in the ticket of an update", self.recorded))
        })?;
        let at = usize::try_from(age).ok().and_then(|age| self.kept.len().checked_sub(age + 1));
        at.and_then(|at| self.kept.get(at).copied()).ok_or_else(|| {
            Failure::invalid(format!(
                "update {number} of {} is older than the last {KEPT}; discard updates before as many are recorded",
                self.recorded
            ))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tickets_that_never_were_and_old_ones_are_refused() {
        let none = Tickets::default();
        for number in [0, 1, u64::MAX] {
            assert!(none.find(number).unwrap_err().message.contains("hand in the ticket of an update"));
        }
        let old = Tickets { recorded: 5000, kept: VecDeque::new() };
        assert!(old.find(5000).unwrap_err().message.contains("older than the last 1024"));
    }
}
