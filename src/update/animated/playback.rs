//! Host state of the instances of a crowd animated on the GPU: what each plays, and which updates wrote its poses.

use super::clips::Clips;
use super::sample::{Playback, PlaybackRecord, TICKS_PER_SECOND};
use crate::abi::numbers::{HIDDEN, LOOP, PLAYING, REVERSED};
use crate::error::{Result, ensure, refuse};
use crate::plan::instances::{InstanceState, Instances};
use crate::weights::Repeat;
use std::ops::Range;

/// Elapsed ticks after which a record is rebased (4.5 hours): half of the exact range. Also the limit of starts in the
/// future.
const REBASE_TICKS: i64 = 1 << 30;
/// Elapsed ticks after rebasing, so that the clock can go back as far (an hour).
const REBASE_MARGIN: i64 = REBASE_TICKS / 4;
/// Changes remembered per instance, for updates that are discarded.
const CHANGES: usize = 8;
/// Limit of clock times; below it, ticks are exact in an `f64`.
const SECONDS_MAX: f64 = (1u64 << 36) as f64;

#[derive(Clone, Debug, Default)]
struct State {
    /// Updates from which on it is shown, with a reset (`true`), or hidden; latest first. Empty: it has no pose, or too
    /// many changes were discarded.
    changes: [Option<(u64, bool)>; CHANGES],
    /// The next pose is its own previous pose.
    is_reset: bool,
    /// The record differs from the device's.
    stale: bool,
    /// The update that sent the record to the device.
    sent: u64,
    /// It is in [`Playbacks::pending`].
    listed: bool,
}

/// The instances of a crowd: records, clock, and what each update writes.
///
/// Updates are numbered from 0; numbers of discarded updates are reused.
#[derive(Clone, Debug)]
pub struct Playbacks {
    states: Vec<State>,
    /// Records, and the full ticks of their starts.
    records: Vec<PlaybackRecord>,
    starts: Vec<i64>,
    now: i64,
    updates: u64,
    /// Instances changed since the last update.
    pending: Vec<u32>,
    changed: Vec<Range<u32>>,
}

impl Playbacks {
    /// `count` instances that play nothing, at time 0.
    pub fn new(count: u32) -> Self {
        let state = State { listed: true, ..State::default() };
        Self {
            states: vec![state; count as usize],
            records: vec![PlaybackRecord::default(); count as usize],
            starts: vec![0; count as usize],
            now: 0,
            updates: 0,
            pending: (0..count).collect(),
            changed: Vec::with_capacity(count as usize),
        }
    }

    /// Starts as if `updates` updates had been recorded.
    pub fn begin_at(&mut self, updates: u64) {
        self.updates = updates;
    }

    /// Sets the clock of the next update. It may stand still, or go back by up to an hour.
    ///
    /// # Errors
    /// `seconds` is not finite or too large; more than 4.5 hours before an instance's start.
    pub fn set_time(&mut self, seconds: f64) -> Result<()> {
        let now = ticks(seconds)?;
        let mut playing = self.starts.iter().zip(&self.records);
        let is_early = playing.any(|(start, record)| record.has(PLAYING) && start - now > REBASE_TICKS);
        let what = || format!("second {seconds}, more than 4.5 hours before an instance starts");
        ensure!(!is_early, what(), "play its clip again at the new time first");
        self.now = now;
        Ok(())
    }

    /// Low bits of the next update's tick.
    pub fn now(&self) -> u32 {
        self.now as u32
    }

    /// Plays a clip on an instance, from the next update on.
    ///
    /// # Errors
    /// No such clip; a speed or start that is not finite or too large; a start more than 4.5 hours ahead.
    pub fn play(&mut self, instance: u32, playback: &Playback, clips: &Clips) -> Result<()> {
        let Playback { clip, start, speed, repeat } = *playback;
        let Some(fps) = clips.fps(clip as usize) else {
            return refuse(format!("clip {clip} of {}", clips.count()), "count clips from 0");
        };
        let rate = (speed.abs() * f64::from(fps) * 65_536.0).round();
        let what = || format!("a speed of {speed} for a clip of {fps} frames a second");
        // Also rejects NaN.
        let fits = (0.0..=f64::from(u32::MAX)).contains(&rate);
        ensure!(fits, what(), "use a speed that makes at most 65535 frames a second");
        let start_tick = ticks(start)?;
        let ahead = start - self.now as f64 / TICKS_PER_SECOND;
        let what = || format!("a clip that starts at second {start}, {ahead} seconds ahead");
        let is_near = start_tick - self.now <= REBASE_TICKS;
        ensure!(is_near, what(), "use a start at most 4.5 hours ahead of the time set");
        let record = &mut self.records[instance as usize];
        let set = |flag, set| if set { flag } else { 0 };
        let flags = PLAYING | record.flags & HIDDEN | set(LOOP, repeat == Repeat::Loop) | set(REVERSED, speed < 0.0);
        let start = start_tick as u32;
        *record = PlaybackRecord { clip, start, rate: rate as u32, flags, frame: 0, fraction: 0, ..*record };
        self.starts[instance as usize] = start_tick;
        self.touch(instance).stale = true;
        Ok(())
    }

    /// Sets how many targets an instance keeps, from the next update on; the number of targets or more keeps all, at no
    /// cost. Nothing is sent to the device if the level is unchanged.
    ///
    /// # Errors
    /// A level that is NaN or negative; clips without an order of importance.
    pub fn set_level(&mut self, instance: u32, level: f32, clips: &Clips) -> Result<()> {
        let Some(ranks_at) = clips.ranks_at() else {
            let what = "a level of detail for a crowd without an order of importance";
            return refuse(what, "give AnimationDesc::importance when the crowd is made");
        };
        ensure!(level >= 0.0, format!("a level of {level} targets"), "use a number from 0");
        let record = &mut self.records[instance as usize];
        let fixed = (f64::from(level) * 65_536.0).round() as u32;
        let set = if level < clips.targets() as f32 { (fixed, ranks_at) } else { (0, 0) };
        if (record.level, record.ranks_at) != set {
            (record.level, record.ranks_at) = set;
            self.touch(instance).stale = true;
        }
        Ok(())
    }

    /// The state of an instance, listed as pending.
    fn touch(&mut self, instance: u32) -> &mut State {
        let touched = &mut self.states[instance as usize];
        if !std::mem::replace(&mut touched.listed, true) {
            self.pending.push(instance);
        }
        touched
    }

    /// Records the next update and returns its number. [`changed`](Self::changed) and [`records`](Self::records) are
    /// then to be sent to the device.
    pub fn update(&mut self, clips: &Clips) -> u64 {
        if self.starts.iter().any(|start| self.now - start >= REBASE_TICKS) {
            self.rebase(clips);
        }
        let update = self.updates;
        self.updates += 1;
        self.changed.clear();
        self.pending.sort_unstable();
        for i in 0..self.pending.len() {
            let number = self.pending[i];
            let state = &mut self.states[number as usize];
            state.listed = false;
            let shown = !self.records[number as usize].has(HIDDEN);
            let was_shown = state.changes[0].is_some_and(|(_, shown)| shown);
            // A hidden instance keeps its reset: the update that hides it may be discarded.
            if shown && std::mem::take(&mut state.is_reset) || shown != was_shown {
                state.changes.rotate_right(1);
                state.changes[0] = Some((update, shown));
            }
            if std::mem::take(&mut state.stale) {
                state.sent = update;
                match self.changed.last_mut() {
                    Some(run) if run.end == number => run.end += 1,
                    _ => self.changed.push(number..number + 1),
                }
            }
        }
        self.pending.clear();
        update
    }

    /// Rebases old records at exactly their current position.
    fn rebase(&mut self, clips: &Clips) {
        for instance in 0..self.states.len() {
            let elapsed = self.now - self.starts[instance];
            let record = &mut self.records[instance];
            if elapsed < REBASE_TICKS / 2 {
                continue;
            }
            let start = self.now - REBASE_MARGIN;
            self.starts[instance] = start;
            if record.has(PLAYING) {
                let position = record.position(clips.frame_count(record.clip as usize), elapsed - REBASE_MARGIN);
                (record.frame, record.fraction) = ((position >> 32) as u32, position as u32);
                record.start = start as u32;
                self.touch(instance as u32).stale = true;
            }
        }
    }

    /// Ranges of instances whose records the last update sends.
    pub fn changed(&self) -> &[Range<u32>] {
        &self.changed
    }

    /// All records.
    pub fn records(&self) -> &[PlaybackRecord] {
        &self.records
    }

    /// Discards update `first` and all later ones; the next update sends what they would have.
    pub fn discard_from(&mut self, first: u64) {
        if self.updates <= first {
            return;
        }
        self.updates = first;
        for number in 0..self.states.len() as u32 {
            let state = &mut self.states[number as usize];
            let (sent, mut turned_back) = (state.sent >= first, false);
            while let Some((_, shown)) = state.changes[0].take_if(|(update, _)| *update >= first) {
                state.changes.rotate_left(1);
                (state.is_reset, turned_back) = (state.is_reset | shown, true);
            }
            if sent || turned_back {
                self.touch(number).stale |= sent;
            }
        }
    }

    /// The update that wrote the pose of an instance, and whether the update before it wrote the previous pose; `None`
    /// if it has no pose.
    pub fn written(&self, instance: u32) -> Option<(u64, bool)> {
        match self.states[instance as usize].changes[0]? {
            (since, true) => self.updates.checked_sub(1).map(|update| (update, update != since)),
            // It is not updated any more.
            (since, false) => since.checked_sub(1).map(|update| (update, false)),
        }
    }
}

impl InstanceState for Playbacks {
    fn check_takes_weights(&self) -> Result<()> {
        refuse("weights of a crowd that plays clips", "play a clip, or make the crowd with create_crowd")
    }

    fn set_hidden(&mut self, instance: u32, hidden: bool) {
        let record = &mut self.records[instance as usize];
        if record.has(HIDDEN) != hidden {
            record.flags ^= HIDDEN;
            self.touch(instance).stale = true;
        }
    }

    /// It plays nothing, and has no pose.
    fn add(&mut self, instance: u32) {
        self.records[instance as usize] = PlaybackRecord::default();
        let state = self.touch(instance);
        state.changes = [None; CHANGES];
        state.stale = true;
    }

    fn reset_history(&mut self, instance: u32) {
        self.touch(instance).is_reset = true;
    }

    /// Only the GPU knows which blocks.
    fn changed(&self, _instances: &Instances, _update: u64, _: u32, _group: usize, out: &mut Vec<Range<u32>>) {
        out.push(0..u32::MAX);
    }
}

impl PlaybackRecord {
    /// Position in a clip of `frames` frames, `elapsed` (≥ 0) ticks after the start, in 2⁻³² frames.
    pub fn position(&self, frames: u32, elapsed: i64) -> u64 {
        let start = u64::from(self.frame) << 32 | u64::from(self.fraction);
        let position = u128::from(start) + elapsed as u128 * u128::from(self.rate);
        let frames = u128::from(frames) << 32;
        (if self.has(LOOP) { position % frames } else { position.min(frames - (1 << 32)) }) as u64
    }
}

fn ticks(seconds: f64) -> Result<i64> {
    let remedy = || format!("use numbers from -{SECONDS_MAX} to {SECONDS_MAX}");
    ensure!(seconds.abs() <= SECONDS_MAX, format!("second {seconds} of the clock"), remedy());
    Ok((seconds * TICKS_PER_SECOND).round() as i64)
}
