//! Commands of the window, from the panel or from a script.

use crate::args::render;
use crate::args::values::{self, name};
use crate::args::view::MAX_HEADS;
use crate::detail::Detail;
use clap::ValueEnum;
use deltamorph::{DeltaFormat, PoseFormat, UpdatePath};
use std::path::PathBuf;
use values::BudgetSpec;

/// A command that the panel and scripts have.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    Set(String, f32),
    /// Ends a row of `Set` of one target, which are undone together.
    Settled,
    Undo,
    Redo,
    Reset,
    Random(u64),
    /// Copies the current settings, as `--set` takes them, to the clipboard; in a script, prints them to stdout.
    Copy,
    Clip(PathBuf),
    Play,
    Pause,
    /// Goes to a frame of the clip, counted from 0.
    Scrub(f64),
    Speed(f32),
    Path(UpdatePath),
    Format(DeltaFormat),
    Pose(PoseFormat),
    Budget(BudgetSpec),
    Heads(u32),
    Detail(Detail),
    Show(Look),
    Camera([f32; 2]),
    /// How far the picture is moved to the right and down, in shares of the room for it at zoom 1.
    Pan([f32; 2]),
    /// Fills the window with what the active targets move; at rest, with the face.
    Focus,
    /// The camera as at the beginning.
    Home,
    /// Distance of the camera: at 1 everything fits.
    Zoom(f32),
    /// Whether the camera shows all of the scene, not only what targets move.
    Whole(bool),
    Search(String),
    /// Whether only sliders of active targets are listed.
    Active(bool),
    /// Whether left and right targets move together.
    Twins(bool),
    Panel(bool),
    /// Width of the panel in points; its height where it is below the heads.
    Width(f32),
    /// Whether keys and mouse are explained.
    Help(bool),
    /// Closes the notice.
    Dismiss,
    /// Opens a mesh or a clip like a file or folder dropped on the window. Errors are shown in the window.
    Drop(PathBuf),
}

/// A step of a script.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    Do(Command),
    /// Draws this many frames.
    Frames(u64),
    Resize([u32; 2]),
    Screenshot(PathBuf),
    Stats(PathBuf),
    Quit,
}

/// What is shown of surfaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Look {
    /// Skin, eyes and teeth in their light
    #[default]
    Shaded,
    /// The edges of faces
    Wire,
    /// Normals as colours
    Normals,
    /// How far each vertex is from the base pose
    Heat,
    /// How far each vertex has come since the frame before
    Motion,
    /// Blocks of vertices light up as they are written
    Blocks,
    /// Wrinkles where the targets compress the skin
    Wrinkles,
}

/// Parses a line of a script; `None` if it is empty or a comment. Errors state a remedy.
pub fn parse(line: &str) -> Result<Option<Step>, String> {
    // Names may contain a #: only one after a space begins a comment.
    let line = line.trim();
    let line = if line.starts_with('#') { "" } else { line.split(" #").next().unwrap_or_default().trim() };
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let rest = rest.trim();
    let named = |what: &str| match rest.is_empty() {
        true => Err(format!("{word}: the {what} is missing; write `{word} {}`", what.to_uppercase())),
        false => Ok(rest),
    };
    let path = || named("file").map(PathBuf::from);
    let switch = || match rest {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err(format!("{word}: write `{word} on` or `{word} off`")),
    };
    let say = |error: String| format!("{word} {rest}: {error}");
    let number = |what, fits: fn(f32) -> bool| values::number(what, fits)(rest).map_err(say);
    let alone = match word {
        "" => return Ok(None),
        "reset" => Some(Step::Do(Command::Reset)),
        "undo" => Some(Step::Do(Command::Undo)),
        "redo" => Some(Step::Do(Command::Redo)),
        "focus" => Some(Step::Do(Command::Focus)),
        "home" => Some(Step::Do(Command::Home)),
        "copy" => Some(Step::Do(Command::Copy)),
        "play" => Some(Step::Do(Command::Play)),
        "dismiss" => Some(Step::Do(Command::Dismiss)),
        "pause" => Some(Step::Do(Command::Pause)),
        "quit" => Some(Step::Quit),
        _ => None,
    };
    if alone.is_some() {
        let rest = if rest.is_empty() { Ok(alone) } else { Err(rest) };
        return rest.map_err(|rest| format!("{word}: takes nothing, and there is '{rest}'; leave it out"));
    }
    let command = match word {
        "set" => {
            let parsed =
                rest.rsplit_once(char::is_whitespace).and_then(|(name, w)| Some((name.trim(), w.parse().ok()?)));
            let Some((name, weight)) = parsed.filter(|(_, weight): &(_, f32)| weight.is_finite()) else {
                return Err(say("write `set NAME WEIGHT`, as in `set jawOpen 0.5`".into()));
            };
            Command::Set(name.to_owned(), weight)
        }
        "random" => Command::Random(values::whole(0, u64::MAX)(rest).map_err(say)?),
        "clip" => Command::Clip(path()?),
        "drop" => Command::Drop(path()?),
        "scrub" => Command::Scrub(number("a frame of the clip, counted from 0", |v| v >= 0.0)?.into()),
        "speed" => Command::Speed(number("a number from 0.05 to 8", |v| (0.05..=8.0).contains(&v))?),
        "path" => Command::Path(one_of(&UpdatePath::ALL, |path| path.name().into(), rest).map_err(say)?),
        "format" => Command::Format(one_of(&DeltaFormat::ALL, |format| format.name().into(), rest).map_err(say)?),
        "pose" => Command::Pose(one_of(&PoseFormat::ALL, |pose| pose.name().into(), rest).map_err(say)?),
        "show" => Command::Show(one_of(Look::value_variants(), name, rest).map_err(say)?),
        "budget" => Command::Budget(values::budget(rest).map_err(say)?),
        "detail" => Command::Detail(Detail::parse(rest).map_err(say)?),
        "heads" => Command::Heads(values::whole(1, MAX_HEADS)(rest).map_err(say)?),
        "camera" => Command::Camera(render::camera(rest).map_err(say)?),
        "zoom" => Command::Zoom(values::zoom(rest).map_err(say)?),
        "pan" => Command::Pan(pan(rest).ok_or_else(|| say("write `pan X,Y`, as in `pan 0.2,-0.1`".into()))?),
        "search" => Command::Search(rest.to_owned()),
        "active" => Command::Active(switch()?),
        "width" => Command::Width(number("a number of points from 100 to 4000", |v| (100.0..=4000.0).contains(&v))?),
        "help" => Command::Help(switch()?),
        "twins" => Command::Twins(switch()?),
        "whole" => Command::Whole(switch()?),
        "panel" => Command::Panel(switch()?),
        "frames" => return Ok(Some(Step::Frames(values::whole(1, 1_000_000_000)(rest).map_err(say)?))),
        "resize" => {
            let size = rest.split_once([' ', 'x']).map(|(w, h)| format!("{}x{}", w.trim(), h.trim()));
            return Ok(Some(Step::Resize(render::size(&size.unwrap_or_default()).map_err(say)?)));
        }
        "screenshot" => return Ok(Some(Step::Screenshot(path()?))),
        "stats" => return Ok(Some(Step::Stats(path()?))),
        unknown => return Err(format!("'{unknown}' is no command; `deltamorph view --help` lists them")),
    };
    Ok(Some(Step::Do(command)))
}

fn pan(text: &str) -> Option<[f32; 2]> {
    let (x, y) = text.split_once(',')?;
    let number = |text: &str| text.trim().parse().ok().filter(|v: &f32| v.abs() <= 100.0);
    Some([number(x)?, number(y)?])
}

fn one_of<T: Copy>(all: &[T], name: fn(T) -> String, given: &str) -> Result<T, String> {
    let names: Vec<String> = all.iter().map(|one| name(*one)).collect();
    let at = names.iter().position(|name| name == given);
    at.map(|at| all[at]).ok_or_else(|| format!("give one of: {}", names.join(", ")))
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
        let lines = "set jaw open 0.5\nreset\nrandom 7\ncopy\nclip a b.csv\nplay\npause\nscrub 12.5\nspeed 2\npath blocks\n\
                     format small\npose fixed16\nbudget 1e-4d\nheads 3\ndetail all\ndetail 50%\ndetail 0.5px\nshow heat\ncamera -20,5\nzoom 2\nsearch jaw\n\
                     twins off\npanel on\nundo\nredo\npan 0.5,-1\nfocus\nhome\nactive on\nwidth 400\nhelp off\ndismiss\ndrop x#y.glb # a remark\nframes 3\nresize 640 480\nresize 640x480\n\
                     screenshot a.png\nstats s.json\nwhole on\nquit\n\n# nothing\n";
        let steps = script(lines).expect("commands");
        assert_eq!(steps.len(), 40);
        assert_eq!(steps[0], (1, Step::Do(Command::Set("jaw open".into(), 0.5))));
        let details = [Detail::All, Detail::Share(0.5), Detail::Pixels(0.5)];
        assert_eq!([14, 15, 16].map(|i| steps[i].1.clone()), details.map(|detail| Step::Do(Command::Detail(detail))));
        assert_eq!(steps[32].1, Step::Do(Command::Drop("x#y.glb".into())));
        assert_eq!((&steps[34].1, &steps[35].1), (&Step::Resize([640, 480]), &Step::Resize([640, 480])));
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
            ("play now", "leave it out"),
            ("path fast", "give one of: "),
            ("show", "give one of: shaded, wire"),
            ("resize 640", "give width and height, as in 768x768"),
            ("resize 0 5", "a whole number from 16"),
            ("frames 0", "a whole number from 1"),
            ("twins maybe", "`twins on` or `twins off`"),
            ("drop", "the file is missing"),
            ("camera 1", "degrees around"),
            ("detail 120%", "a share as 50%"),
            ("detail -1px", "pixels as 0.5px"),
            ("speed 99", "from 0.05 to 8"),
            ("pan 1", "write `pan X,Y`"),
            ("width 9", "from 100 to 4000"),
        ] {
            let error = script(text).expect_err(text);
            assert!(error.starts_with("line ") && error.contains(says), "{text}: {error}");
        }
    }
}
