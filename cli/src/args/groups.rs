//! The headings that `--help` has options under.

use clap::Command;

/// Options that several commands have. What is in no group is under "Options".
const GROUPS: [(&str, &[&str]); 4] = [
    ("What is read", &["tolerance", "fps", "normalise", "seed"]),
    ("The built-in head", &["vertices", "targets", "sparsity"]),
    (
        "How poses are updated",
        &[
            "paths",
            "modes",
            "slots",
            "formats",
            "poses",
            "accumulate",
            "drift",
            "error_budget",
            "threads",
            "batch_size",
        ],
    ),
    ("How deltas are packed", &["block_size", "position_error", "normal_error", "weight_max"]),
];

/// Puts the options of each command under their headings.
pub fn grouped(command: Command) -> Command {
    command.mut_subcommands(|command| {
        command.mut_args(|arg| {
            let own = GROUPS.iter().find(|(_, options)| options.contains(&arg.get_id().as_str()));
            match own {
                Some((heading, _)) => arg.help_heading(*heading),
                None => arg,
            }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::Cli;
    use clap::CommandFactory;

    #[test]
    fn every_option_named_is_one() {
        let command = Cli::command();
        let all = || command.get_subcommands().flat_map(Command::get_arguments).map(|arg| arg.get_id().as_str());
        for name in GROUPS.iter().flat_map(|(_, options)| *options) {
            assert!(all().any(|id| id == *name), "{name}");
        }
    }
}
