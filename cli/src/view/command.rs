//! Commands of the window, from the panel or from a script.

use crate::args::render;
use crate::args::values;
use deltamorph_render::Show;
use std::path::PathBuf;

/// What the window shows: whatever is not a stream of its own in the mesh.
pub const LOOKS: &[(Show, &str, &str)] = render::LOOKS.split_at(6).0;

/// A command that the panel and scripts have.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    Set(String, f32),
    Reset,
    Clip(PathBuf),
    Play,
    Pause,
    /// Goes to a frame of the clip, counted from 0.
    Scrub(f64),
    Show(Show),
    Camera([f32; 2]),
    /// How far the picture is moved to the right and down, in shares of the room for it at zoom 1.
    Pan([f32; 2]),
    /// Distance of the camera: at 1 everything fits.
    Zoom(f32),
    /// The camera as at the beginning.
    Home,
    Panel(bool),
}

/// A step of a script.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    Do(Command),
    /// Draws this many frames.
    Frames(u64),
    Resize([u32; 2]),
    Screenshot(PathBuf),
    Quit,
}

/// Parses a line of a script; `None` if it is empty or a comment. Errors state a remedy.
pub fn parse(line: &str) -> Result<Option<Step>, String> {
    // Names may contain a #: only one after a space begins a comment.
    let line = line.trim();
    let line = if line.starts_with('#') { "" } else { line.split(" #").next().unwrap_or_default().trim() };
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let rest = rest.trim();
    let path = || {
        if rest.is_empty() {
            Err(format!("{word}: the file is missing; write `{word} FILE`"))
        } else {
            Ok(PathBuf::from(rest))
        }
    };
    let say = |error: String| format!("{word} {rest}: {error}");
    let command = match (word, rest) {
        ("", _) => return Ok(None),
        ("quit", "") => return Ok(Some(Step::Quit)),
        ("reset", "") => Command::Reset,
        ("home", "") => Command::Home,
        ("play", "") => Command::Play,
        ("pause", "") => Command::Pause,
        ("panel", "on") => Command::Panel(true),
        ("panel", "off") => Command::Panel(false),
        ("set", _) => {
            let parsed =
                rest.rsplit_once(char::is_whitespace).and_then(|(name, w)| Some((name.trim(), w.parse().ok()?)));
            let Some((name, weight)) = parsed.filter(|(_, weight): &(_, f32)| weight.is_finite()) else {
                return Err(say("write `set NAME WEIGHT`, as in `set jawOpen 0.5`".into()));
            };
            Command::Set(name.to_owned(), weight)
        }
        ("clip", _) => Command::Clip(path()?),
        ("scrub", _) => {
            let frame = values::number("a frame of the clip, counted from 0", |v| v >= 0.0)(rest);
            Command::Scrub(frame.map_err(say)?.into())
        }
        ("show", _) => Command::Show(look(rest).map_err(say)?),
        ("camera", _) => Command::Camera(render::camera(rest).map_err(say)?),
        ("zoom", _) => Command::Zoom(values::zoom(rest).map_err(say)?),
        ("pan", _) => Command::Pan(
            render::pair(rest, [100.0; 2]).ok_or_else(|| say("write `pan X,Y`, as in `pan 0.2,-0.1`".into()))?,
        ),
        ("frames", _) => return Ok(Some(Step::Frames(values::whole(1, 1_000_000_000)(rest).map_err(say)?))),
        ("resize", _) => {
            let size = rest.split_once([' ', 'x']).map(|(w, h)| format!("{}x{}", w.trim(), h.trim()));
            return Ok(Some(Step::Resize(render::size(&size.unwrap_or_default()).map_err(say)?)));
        }
        ("screenshot", _) => return Ok(Some(Step::Screenshot(path()?))),
        _ => return Err(format!("'{line}' is no command; `deltamorph view --help` lists them")),
    };
    Ok(Some(Step::Do(command)))
}

fn look(text: &str) -> Result<Show, String> {
    let look = LOOKS.iter().find(|look| look.1 == text).map(|look| look.0);
    look.ok_or_else(|| format!("give one of: {}", LOOKS.iter().map(|look| look.1).collect::<Vec<_>>().join(", ")))
}

/// Parses a script: its steps with their lines, counted from 1.
pub fn script(text: &str) -> Result<Vec<(usize, Step)>, String> {
    let step = |(line, text)| match parse(text) {
        Ok(step) => step.map(|step| Ok((line, step))),
        Err(error) => Some(Err(format!("line {line}: {error}"))),
    };
    (1..).zip(text.lines()).filter_map(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::view::HELP;

    #[test]
    fn every_command_of_the_help_is_read() {
        let lines = "set jaw open 0.5\nreset\nclip a b.csv\nplay\npause\nscrub 12.5\n\
                     show heat\ncamera -20,5\nzoom 2\npan 0.5,-1\nhome\npanel off # a remark\n\
                     frames 3\nresize 640 480\nresize 640x480\nscreenshot x#y.png\nquit\n\n# nothing\n";
        let steps = script(lines).expect("commands");
        assert_eq!(steps.len(), 17);
        assert_eq!(steps[0], (1, Step::Do(Command::Set("jaw open".into(), 0.5))));
        assert_eq!(steps[11].1, Step::Do(Command::Panel(false)));
        assert_eq!((&steps[13].1, &steps[14].1), (&Step::Resize([640, 480]), &Step::Resize([640, 480])));
        assert_eq!(steps[15].1, Step::Screenshot("x#y.png".into()));
        for word in lines.lines().filter_map(|line| line.split_whitespace().next()).filter(|word| *word != "#") {
            assert!(HELP.contains(&format!("{word} ")) || HELP.contains(&format!("{word}\n")), "{word}");
        }
    }

    #[test]
    fn what_is_wrong_comes_with_the_line_and_a_remedy() {
        for (text, says) in [
            ("frames 3\njump", "line 2: 'jump' is no command"),
            ("set jawOpen", "write `set NAME WEIGHT`"),
            ("set jawOpen NaN", "write `set NAME WEIGHT`"),
            ("play now", "'play now' is no command"),
            ("show wrinkles", "give one of: shaded, wire"),
            ("resize 640", "give width and height, as in 768x768"),
            ("resize 0 5", "a whole number from 16"),
            ("frames 0", "a whole number from 1"),
            ("panel maybe", "'panel maybe' is no command"),
            ("clip", "the file is missing"),
            ("camera 1", "degrees around"),
            ("pan 1", "write `pan X,Y`"),
        ] {
            let error = script(text).expect_err(text);
            assert!(error.starts_with("line ") && error.contains(says), "{text}: {error}");
        }
    }
}
