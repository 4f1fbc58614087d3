//! The run: kill, start again, look; at the end let the dust settle and count what is left.

use std::collections::{BTreeSet, HashSet};
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::FileExt;
use std::thread;
use std::time::{Duration, Instant};

use conduit_ring::{
    Info, Publisher, PublisherOptions, State, Subscriber, SubscriberOptions, clock,
};
use program::stop::Stop;
use program::{Failure, Log};

use crate::plan::{self, LINES, LONG_MESSAGE, Manner, Role, Source};
use crate::random::Random;
use crate::report::Report;
use crate::stage::Stage;

/// How a run goes.
#[derive(Clone, Debug)]
pub struct Settings {
    /// How many processes are killed.
    pub kills: u64,
    /// What the random choices follow from.
    pub seed: u64,
    /// How a BEAM node is started; nothing for a run without.
    pub node_command: Vec<String>,
    /// In what time a topic whose publisher and reader live must give a message; twice as much after the last kill, since
    /// BEAM nodes have to start in it.
    pub patience: Duration,
    /// A fault to make on purpose, which the run must find.
    pub inject: Option<Inject>,
}

/// Faults that prove that the run finds faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inject {
    /// A publisher spoils some messages.
    Torn,
    /// A number is taken back after its publisher was killed, and given to another message.
    Reused,
    /// Somebody holds a topic, so that no publisher gets it.
    Stuck,
    /// A reader slot is marked as taken, and nobody has it.
    Leaked,
}

/// The average pause between two kills, and the longest pause between a death and the next life.
const PACE: Duration = Duration::from_millis(40);
const REST: Duration = Duration::from_millis(40);
/// A process that has just been started is at times killed again this soon, in the midst of opening.
const INFANCY: Duration = Duration::from_millis(4);
/// A publisher of long messages is at times killed in the midst of one, if one comes this soon.
const AIM: Duration = Duration::from_millis(400);
const LOOK: Duration = Duration::from_millis(10);
const TOLD_EVERY: Duration = Duration::from_secs(10);
/// A node is killed this much less often than a native process: it takes longer to start than all others together.
const NODE_IN: u64 = 2;
/// The topic on which faults are injected.
const VICTIM: usize = 0;

/// Runs it to the end, or to the stop.
pub fn run(settings: &Settings, stop: &Stop, log: Log) -> Result<Report, Failure> {
    let stage = Stage::new(settings.node_command.clone(), log).map_err(world)?;
    let mut run = Run {
        random: Random::new(settings.seed),
        stage,
        settings,
        kills: 0,
        node_kills: 0,
        half_written: HashSet::new(),
        stuck: BTreeSet::new(),
        usurper: None,
        started: Instant::now(),
        next_told: Instant::now() + TOLD_EVERY,
        log,
    };
    run.prepare();
    run.storm(stop).map_err(world)?;
    let settled = run.settle().map_err(world)?;
    let leaked = run.count_leaked()?;
    Ok(run.report(settled, leaked))
}

struct Run<'a> {
    random: Random,
    stage: Stage,
    settings: &'a Settings,
    kills: u64,
    node_kills: u64,
    /// The messages that were left half-written, with their topics.
    half_written: HashSet<(usize, Message)>,
    stuck: BTreeSet<usize>,
    usurper: Option<Publisher>,
    started: Instant,
    next_told: Instant,
    log: Log,
}

impl Run<'_> {
    fn prepare(&mut self) {
        if self.settings.inject == Some(Inject::Torn) {
            for actor in &mut self.stage.actors {
                actor.corrupt = actor.role == Role::Publisher(VICTIM);
            }
        }
    }

    fn storm(&mut self, stop: &Stop) -> io::Result<()> {
        let mut next_kill = Instant::now() + 10 * PACE;
        let mut next_look = Instant::now();
        let mut doomed: Vec<(Instant, usize)> = Vec::new();
        while self.kills < self.settings.kills && !stop.requested() {
            let now = Instant::now();
            doomed.extend(self.start_due(now)?);
            if let Some(at) = doomed.iter().position(|(when, _)| *when <= now) {
                let (_, index) = doomed.swap_remove(at);
                self.kill(index)?;
            } else if now >= next_kill {
                let index = self.victim();
                self.kill(index)?;
                next_kill = now + self.random.up_to(2 * PACE);
            }
            if now >= next_look {
                self.look()?;
                next_look = Instant::now() + LOOK;
            }
            let next = doomed.iter().map(|(when, _)| *when).min();
            let wake = next.map_or(next_kill, |next| next.min(next_kill));
            let wake = self.next_start().map_or(wake, |due| due.min(wake));
            thread::sleep(
                wake.min(next_look)
                    .saturating_duration_since(Instant::now()),
            );
        }
        Ok(())
    }

    /// Starts those whose rest is over; some of them are doomed to die at once.
    fn start_due(&mut self, now: Instant) -> io::Result<Vec<(Instant, usize)>> {
        let mut doomed = Vec::new();
        for index in 0..self.stage.actors.len() {
            let actor = &self.stage.actors[index];
            if actor.life.is_none() && actor.due <= now {
                let role = actor.role;
                self.stage.start(index, &mut self.random)?;
                if !role.is_node() && self.random.one_in(4) {
                    doomed.push((Instant::now() + self.random.up_to(INFANCY), index));
                }
            }
        }
        Ok(doomed)
    }

    fn next_start(&self) -> Option<Instant> {
        let resting = |actor: &&crate::stage::Actor| actor.life.is_none();
        self.stage
            .actors
            .iter()
            .filter(resting)
            .map(|actor| actor.due)
            .min()
    }

    fn victim(&mut self) -> usize {
        loop {
            let index = self.random.below(self.stage.actors.len() as u64) as usize;
            if !self.stage.actors[index].role.is_node() || self.random.one_in(NODE_IN) {
                return index;
            }
        }
    }

    fn kill(&mut self, index: usize) -> io::Result<()> {
        if self.stage.actors[index].life.is_none() {
            return Ok(());
        }
        let role = self.stage.actors[index].role;
        let written = plan::topics(self.stage.with_nodes())
            .map(|(topic, _)| topic)
            .find(|&topic| role.publishes(topic));
        if let Some(topic) = written
            && LINES[topic].slot_size as usize > LONG_MESSAGE
            && !self.random.one_in(4)
        {
            self.await_midst(topic)?;
        }
        self.stage.kill(index)?;
        self.kills += 1;
        self.node_kills += u64::from(role.is_node());
        if let Some(topic) = written {
            self.note_half_written(topic)?;
        }
        if role == Role::Publisher(VICTIM) {
            self.harm_after_death()?;
        }
        let rest = if self.random.one_in(2) {
            Duration::ZERO
        } else {
            self.random.up_to(REST)
        };
        self.stage.actors[index].due = Instant::now() + rest;
        Ok(())
    }

    fn look(&mut self) -> io::Result<()> {
        self.stage.read_logs()?;
        self.stage.look_for_ended(self.settings.patience)?;
        let now_ns = clock::now_ns();
        for (topic, line) in plan::topics(self.stage.with_nodes()) {
            let silence = match self.stage.judge.newest(topic as u32) {
                Some(newest) => Duration::from_nanos(now_ns.saturating_sub(newest)),
                None => self.started.elapsed(),
            };
            let undisturbed = self.stage.undisturbed(topic).unwrap_or_default();
            if silence.min(undisturbed) > self.settings.patience && self.stuck.insert(topic) {
                self.log.line(format!("topic {} is stuck", line.label));
            }
        }
        self.tell();
        Ok(())
    }

    fn tell(&mut self) {
        if Instant::now() < self.next_told {
            return;
        }
        self.next_told += TOLD_EVERY;
        let judge = &self.stage.judge;
        self.log.line(format!(
            "{} of {} kills, {} of BEAM nodes; {} messages accepted, {} torn, {} numbers reused",
            self.kills,
            self.settings.kills,
            self.node_kills,
            judge.messages,
            judge.torn,
            judge.reused
        ));
    }

    /// Starts everyone once more and waits until each reader has a message that was published after the last kill.
    fn settle(&mut self) -> io::Result<Duration> {
        let last_kill = Instant::now();
        let last_kill_ns = clock::now_ns();
        self.dismiss(|role| matches!(role, Role::Reader(_, Manner::Restless)))?;
        loop {
            let now = Instant::now();
            for index in 0..self.stage.actors.len() {
                let actor = &self.stage.actors[index];
                if actor.life.is_none() && !dismissed(actor.role) && actor.due <= now {
                    self.stage.start(index, &mut self.random)?;
                }
            }
            self.stage.read_logs()?;
            self.stage.look_for_ended(2 * self.settings.patience)?;
            let silent: Vec<usize> = plan::topics(self.stage.with_nodes())
                .map(|(topic, _)| topic)
                .filter(|&topic| !self.stage.flows(topic, last_kill_ns))
                .collect();
            if silent.is_empty() || last_kill.elapsed() > 2 * self.settings.patience {
                for topic in silent {
                    self.log
                        .line(format!("topic {} does not flow again", LINES[topic].label));
                    self.stuck.insert(topic);
                }
                return Ok(last_kill.elapsed());
            }
            thread::sleep(LOOK);
        }
    }

    /// Ends processes whose coming and going would blur the count; that is not counted as a kill.
    fn dismiss(&mut self, which: impl Fn(Role) -> bool) -> io::Result<()> {
        for index in 0..self.stage.actors.len() {
            if which(self.stage.actors[index].role) {
                self.stage.kill(index)?;
            }
        }
        Ok(())
    }

    /// Reader slots that nobody has and nobody can get. On each topic as many subscribers are opened as it takes: together
    /// with those that live there must be sixteen. The first one's claim takes back what dead readers left; no doctor helps.
    fn count_leaked(&mut self) -> Result<u64, Failure> {
        let restless = |role| matches!(role, Role::Publisher(topic) if LINES[topic].source == Source::Native(Manner::Restless));
        self.dismiss(restless).map_err(world)?;
        if self.settings.inject == Some(Inject::Leaked) {
            self.mark_slot().map_err(world)?;
        }
        let mut leaked = 0;
        for (topic, line) in plan::topics(self.stage.with_nodes()) {
            let count = self.leaked_on(topic)?;
            if count != 0 {
                self.log.line(format!(
                    "topic {} has {count} reader slots too few",
                    line.label
                ));
            }
            leaked += count;
        }
        Ok(leaked)
    }

    fn leaked_on(&self, number: usize) -> Result<u64, Failure> {
        let topic = self.stage.topic(number).map_err(world)?;
        let deadline = Instant::now() + self.settings.patience;
        loop {
            match Info::read(&topic) {
                // Its publisher was ended between two of its lives.
                Err(conduit_ring::Error::NoTopic { .. }) => return Ok(0),
                Ok(info) if !matches!(info.state, State::Live | State::Dead) => return Ok(0),
                _ => {}
            }
            let live = self
                .stage
                .actors
                .iter()
                .filter(|actor| actor.life.is_some() && actor.role.reads(number))
                .count();
            let mut guests = Vec::new();
            while let Ok(guest) = Subscriber::open(&topic, &SubscriberOptions::default()) {
                guests.push(guest);
                if guests.len() > 16 {
                    break;
                }
            }
            let missing = 16_usize.abs_diff(guests.len() + live);
            if missing == 0 || Instant::now() > deadline {
                return Ok(missing as u64);
            }
            // A reader may still be on its way from one segment to the next.
            drop(guests);
            thread::sleep(10 * LOOK);
        }
    }

    /// Waits until a message is being written. What a predecessor left half-written does not count.
    fn await_midst(&self, topic: usize) -> io::Result<()> {
        let deadline = Instant::now() + AIM;
        let Some(file) = self.file(topic)? else {
            return Ok(());
        };
        while Instant::now() < deadline {
            if in_midst(&file).is_some_and(|message| !self.half_written.contains(&(topic, message)))
            {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Notes the message that the dead publisher was in the midst of, if it was.
    fn note_half_written(&mut self, topic: usize) -> io::Result<()> {
        if let Some(message) = self.file(topic)?.as_ref().and_then(in_midst) {
            self.half_written.insert((topic, message));
        }
        Ok(())
    }

    fn file(&self, topic: usize) -> io::Result<Option<File>> {
        let topic = self.stage.topic(topic).map_err(io::Error::other)?;
        Ok(File::open(topic.path()).ok())
    }

    fn harm_after_death(&mut self) -> io::Result<()> {
        match self.settings.inject {
            Some(Inject::Reused) => self.take_number_back(),
            Some(Inject::Stuck) if self.usurper.is_none() => {
                let options = PublisherOptions {
                    geometry: LINES[VICTIM].geometry(0).map_err(io::Error::other)?,
                    ..PublisherOptions::default()
                };
                let topic = self.stage.topic(VICTIM).map_err(io::Error::other)?;
                self.usurper = Publisher::open(&topic, &options).ok();
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn take_number_back(&self) -> io::Result<()> {
        const WRITE_IDX: u64 = 64;
        self.change_word(WRITE_IDX, |published| published.saturating_sub(1))
    }

    fn mark_slot(&self) -> io::Result<()> {
        const SUBSCRIBER_MASK: u64 = 128;
        self.change_word(SUBSCRIBER_MASK, |mask| mask | 1 << 15)
    }

    fn change_word(&self, at: u64, change: impl Fn(u32) -> u32) -> io::Result<()> {
        let topic = self.stage.topic(VICTIM).map_err(io::Error::other)?;
        let options = OpenOptions::new().read(true).write(true).open(topic.path());
        let Ok(file) = options else {
            return Ok(());
        };
        let mut word = [0; 4];
        file.read_exact_at(&mut word, at)?;
        file.write_all_at(&change(u32::from_le_bytes(word)).to_le_bytes(), at)
    }

    fn report(&self, settled: Duration, leaked: u64) -> Report {
        let judge = &self.stage.judge;
        let ended = &self.stage.ended;
        for finding in &judge.findings {
            self.log.line(finding);
        }
        Report {
            seed: self.settings.seed,
            kills: self.kills,
            node_kills: self.node_kills,
            half_written: self.half_written.len() as u64,
            messages: judge.messages,
            torn: judge.torn,
            stuck: self.stuck.len().max(usize::from(!ended.is_empty())) as u64,
            leaked,
            reused: judge.reused,
            untold: judge.untold,
            seconds: self.started.elapsed().as_secs(),
            settled_ms: settled.as_millis() as u64,
        }
    }
}

/// A message by its segment and number.
type Message = (u64, u64);

/// The message that is being written, if there is one.
fn in_midst(file: &File) -> Option<Message> {
    const INSTANCE: usize = 32;
    const WRITE_IDX: usize = 64;
    const WRITE_INTENT: usize = 72;
    let mut head = [0; 80];
    file.read_exact_at(&mut head, 0).ok()?;
    let long = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let (published, intended) = (long(WRITE_IDX), long(WRITE_INTENT));
    (intended == published.wrapping_add(1)).then(|| (long(INSTANCE), published))
}

fn dismissed(role: Role) -> bool {
    matches!(role, Role::Reader(_, Manner::Restless))
}

fn world(error: impl std::fmt::Display) -> Failure {
    Failure::Runtime(error.to_string())
}
