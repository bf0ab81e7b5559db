//! When and how a report was made.

/// The time, in UTC, as ISO 8601.
pub fn now() -> String {
    jiff::Timestamp::now().strftime("%FT%TZ").to_string()
}

/// The command line of this process, ready to paste into a shell. The program is named without its folder,
/// which means nothing elsewhere.
pub fn command_line() -> String {
    let args = std::env::args_os().skip(1).map(|a| quoted(&a.to_string_lossy()));
    std::iter::once("deltamorph".to_owned()).chain(args).collect::<Vec<_>>().join(" ")
}

/// The processor's name, where the system tells it.
pub fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|l| l.strip_prefix("model name")?.split_once(':'));
    model.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}

/// An argument as a shell needs it.
fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,=:+@%".contains(c);
    if !argument.is_empty() && argument.chars().all(plain) {
        return argument.to_owned();
    }
    format!("'{}'", argument.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_survive_a_shell() {
        assert_eq!(quoted("--batch-sizes=1..7,all"), "--batch-sizes=1..7,all");
        assert_eq!(quoted("my face"), "'my face'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
    }
}
