//! What the CPU knows of the heads of a crowd that is animated on the GPU: what each plays, and which updates wrote it.

use super::clips::Clips;
use super::sample::{HeadRecord, Playback, Repeat, TICKS_PER_SECOND};
use crate::error::{Error, Result};
use std::ops::Range;

/// Elapsed ticks at which a record is started anew (4.5 hours): half of what is exact. Starts may be as far ahead.
const REBASE_TICKS: i64 = 1 << 30;
/// How far back it then starts: the clock may go back as far (an hour).
const REBASE_MARGIN: i64 = REBASE_TICKS / 4;
/// Turns that are remembered of a head, for updates that never run.
const TURNS: usize = 4;
/// Seconds beyond this are no time to animate at; below, ticks are exact in an `f64`.
const SECONDS_MAX: f64 = (1u64 << 36) as f64;

/// Whether a head's poses are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shown {
    /// No update has written it.
    Never,
    /// Every update writes it.
    Yes,
    /// Hidden from this update on.
    Until(u64),
}

#[derive(Clone, Debug)]
struct Head {
    /// The tick at which it started, all of its bits.
    start: i64,
    shown: Shown,
    /// The last updates that hid or showed it, and what was before each of them; the latest first.
    turns: [Option<(u64, Shown)>; TURNS],
    /// The update whose pose has no predecessor.
    cut_at: Option<u64>,
    cut: bool,
    /// Whether the record differs from what the device has.
    stale: bool,
    /// The update that brought the record to the device.
    sent: u64,
    /// Whether it is in the list of heads to look at.
    listed: bool,
}

impl Head {
    /// Hidden or shown by `update`.
    fn turn(&mut self, update: u64, shown: Shown) {
        self.turns.rotate_right(1);
        let forgotten = self.turns[0].replace((update, std::mem::replace(&mut self.shown, shown)));
        if let (Some(_), Some((_, before))) = (forgotten, self.turns.last_mut().and_then(Option::as_mut)) {
            *before = Shown::Never;
        }
    }

    /// As before the update `first`; tells whether that is otherwise.
    fn turn_back(&mut self, first: u64) -> bool {
        let mut turned = false;
        while let Some((_, before)) = self.turns[0].take_if(|(update, _)| *update >= first) {
            self.turns.rotate_left(1);
            (self.shown, turned) = (before, true);
        }
        turned
    }
}

/// The heads of a crowd: records, clock, and what each update writes of them.
///
/// Updates are numbered from 0, and a discarded one gives its number back.
#[derive(Clone, Debug)]
pub struct Playbacks {
    heads: Vec<Head>,
    /// What each plays.
    records: Vec<HeadRecord>,
    now: i64,
    updates: u64,
    /// The latest start of any head, and the earliest.
    starts: (i64, i64),
    /// Heads to look at in the next update.
    pending: Vec<u32>,
    changed: Vec<Range<u32>>,
}

impl Playbacks {
    /// `count` heads that play nothing, at second 0.
    pub fn new(count: u32) -> Self {
        let head = Head {
            start: 0,
            shown: Shown::Never,
            turns: [None; TURNS],
            cut_at: None,
            cut: false,
            stale: false,
            sent: 0,
            listed: true,
        };
        Self {
            heads: vec![head; count as usize],
            records: vec![HeadRecord::default(); count as usize],
            now: 0,
            updates: 0,
            starts: (0, 0),
            pending: (0..count).collect(),
            changed: Vec::with_capacity(count as usize),
        }
    }

    /// The clock is at `seconds` when the next update runs. It may stand still, and go back by up to an hour.
    ///
    /// # Errors
    /// No number, or one too large; more than 4.5 hours before some head's start.
    pub fn set_time(&mut self, seconds: f64) -> Result<()> {
        let now = ticks(seconds)?;
        if self.starts.0 - now > REBASE_TICKS {
            // It may be the start of something that is no longer played.
            let playing = self.heads.iter().zip(&self.records).filter(|(_, record)| record.has(HeadRecord::PLAYING));
            self.starts.0 = playing.map(|(head, _)| head.start).fold(now, i64::max);
        }
        if self.starts.0 - now > REBASE_TICKS {
            return Err(Error::invalid(
                format!("second {seconds}, more than 4.5 hours before a head starts"),
                "play its clip again at the new time first",
            ));
        }
        self.now = now;
        Ok(())
    }

    /// The tick of the next update, as the device reads it.
    pub fn now(&self) -> u32 {
        self.now as u32
    }

    /// Head `head` plays a clip from the next update on.
    ///
    /// # Errors
    /// A clip that there is not; a speed or start that is no number or too large; a start more than 4.5 hours ahead.
    pub fn play(&mut self, head: u32, playback: &Playback, clips: &Clips) -> Result<()> {
        let Playback { clip, start, speed, repeat } = *playback;
        if clip as usize >= clips.count() {
            return Err(Error::invalid(format!("clip {clip} of {}", clips.count()), "count clips from 0"));
        }
        let rate = (speed.abs() * f64::from(clips.fps(clip as usize)) * 65_536.0).round();
        // Not a number fails, too.
        if !(0.0..=f64::from(u32::MAX)).contains(&rate) {
            return Err(Error::invalid(
                format!("a speed of {speed} for a clip of {} frames a second", clips.fps(clip as usize)),
                "use a speed that makes at most 65535 frames a second",
            ));
        }
        let start_tick = ticks(start)?;
        if start_tick - self.now > REBASE_TICKS {
            return Err(Error::invalid(
                format!(
                    "a clip that starts at second {start}, {} seconds ahead",
                    start - self.now as f64 / TICKS_PER_SECOND
                ),
                "use a start at most 4.5 hours ahead of the time set",
            ));
        }
        let record = &mut self.records[head as usize];
        let mut flags = HeadRecord::PLAYING | record.flags & HeadRecord::HIDDEN;
        if repeat == Repeat::Loop {
            flags |= HeadRecord::LOOP;
        }
        if speed < 0.0 {
            flags |= HeadRecord::REVERSED;
        }
        *record = HeadRecord { clip, start: start_tick as u32, rate: rate as u32, flags, ..HeadRecord::default() };
        self.starts = (self.starts.0.max(start_tick), self.starts.1.min(start_tick));
        self.list(head, |head| (head.start, head.stale) = (start_tick, true));
        Ok(())
    }

    /// Leave `head` out of updates from the next one on, or take it up again.
    pub fn set_hidden(&mut self, head: u32, hidden: bool) {
        let record = &mut self.records[head as usize];
        if record.has(HeadRecord::HIDDEN) != hidden {
            record.flags ^= HeadRecord::HIDDEN;
            self.list(head, |head| head.stale = true);
        }
    }

    /// A new head in the place of one that was hidden: it plays nothing, and has no pose yet.
    pub fn add(&mut self, head: u32) {
        self.records[head as usize] = HeadRecord::default();
        self.list(head, |head| {
            (head.shown, head.stale) = (Shown::Never, true);
            head.turns = [None; TURNS];
        });
    }

    /// The next pose of `head` has no predecessor.
    pub fn cut(&mut self, head: u32) {
        self.list(head, |head| head.cut = true);
    }

    fn list(&mut self, head: u32, f: impl FnOnce(&mut Head)) {
        let at = &mut self.heads[head as usize];
        f(at);
        if !std::mem::replace(&mut at.listed, true) {
            self.pending.push(head);
        }
    }

    /// Take the next update as recorded; its number. [`changed`](Self::changed) and [`records`](Self::records) are what
    /// it has to bring to the device.
    pub fn update(&mut self, clips: &Clips) -> u64 {
        if self.now - self.starts.1 >= REBASE_TICKS {
            self.rebase(clips);
        }
        let update = self.updates;
        self.updates += 1;
        self.changed.clear();
        self.pending.sort_unstable();
        for i in 0..self.pending.len() {
            let number = self.pending[i];
            let head = &mut self.heads[number as usize];
            head.listed = false;
            let hidden = self.records[number as usize].has(HeadRecord::HIDDEN);
            let cut = std::mem::take(&mut head.cut);
            match (hidden, head.shown) {
                (true, Shown::Yes) => head.turn(update, Shown::Until(update)),
                (false, Shown::Never | Shown::Until(_)) => {
                    head.turn(update, Shown::Yes);
                    head.cut_at = Some(update);
                }
                (false, Shown::Yes) if cut => head.cut_at = Some(update),
                _ => {}
            }
            if std::mem::take(&mut head.stale) {
                head.sent = update;
                match self.changed.last_mut() {
                    Some(run) if run.end == number => run.end += 1,
                    _ => self.changed.push(number..number + 1),
                }
            }
        }
        self.pending.clear();
        update
    }

    /// Start records anew that have come far, exactly where they are.
    fn rebase(&mut self, clips: &Clips) {
        let (mut latest, mut earliest) = (self.now, self.now);
        for number in 0..self.heads.len() {
            let (now, record) = (self.now, &mut self.records[number]);
            let elapsed = now - self.heads[number].start;
            if elapsed >= REBASE_TICKS / 2 {
                let start = now - REBASE_MARGIN;
                if record.has(HeadRecord::PLAYING) {
                    let position = position(record, clips, elapsed - REBASE_MARGIN);
                    (record.frame, record.fraction) = ((position >> 32) as u32, position as u32);
                    record.start = start as u32;
                    self.list(number as u32, |head| head.stale = true);
                }
                self.heads[number].start = start;
            }
            (latest, earliest) = (latest.max(self.heads[number].start), earliest.min(self.heads[number].start));
        }
        self.starts = (latest, earliest);
    }

    /// Runs of heads whose records the last update brings to the device.
    pub fn changed(&self) -> &[Range<u32>] {
        &self.changed
    }

    /// All records.
    pub fn records(&self) -> &[HeadRecord] {
        &self.records
    }

    /// The update numbered `first` and all later ones will never run. What they would have brought to the device is
    /// brought by the next.
    pub fn discard_from(&mut self, first: u64) {
        if self.updates <= first {
            return;
        }
        self.updates = first;
        for number in 0..self.heads.len() as u32 {
            let head = &mut self.heads[number as usize];
            let (sent, turned) = (head.sent >= first, head.turn_back(first));
            let cut = head.cut_at.is_some_and(|update| update >= first);
            if cut {
                // Until the next update, whose pose has no predecessor again, this one has none either.
                head.cut_at = first.checked_sub(1);
            }
            if sent || turned || cut {
                self.list(number, |head| (head.stale, head.cut) = (head.stale | sent, head.cut | cut));
            }
        }
    }

    /// The update that wrote the pose of `head`, and whether the one before is its predecessor; `None` while it has no
    /// pose.
    pub fn written(&self, head: u32) -> Option<(u64, bool)> {
        let head = &self.heads[head as usize];
        match head.shown {
            Shown::Never => None,
            Shown::Yes => self.updates.checked_sub(1).map(|update| (update, head.cut_at != Some(update))),
            // It does not move.
            Shown::Until(update) => update.checked_sub(1).map(|update| (update, false)),
        }
    }
}

/// As [`HeadRecord::position`], any number of ticks after the start, and within the clip.
fn position(record: &HeadRecord, clips: &Clips, elapsed: i64) -> u64 {
    let start = u64::from(record.frame) << 32 | u64::from(record.fraction);
    let position = u128::from(start) + elapsed as u128 * u128::from(record.rate);
    let frames = u128::from(clips.frames(record.clip as usize)) << 32;
    match record.has(HeadRecord::LOOP) {
        true => (position % frames) as u64,
        false => position.min(frames - (1 << 32)) as u64,
    }
}

fn ticks(seconds: f64) -> Result<i64> {
    if seconds.abs() <= SECONDS_MAX {
        return Ok((seconds * TICKS_PER_SECOND).round() as i64);
    }
    Err(Error::invalid(
        format!("second {seconds} of the clock"),
        format!("use numbers from -{SECONDS_MAX} to {SECONDS_MAX}"),
    ))
}
