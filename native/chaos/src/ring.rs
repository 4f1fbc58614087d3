//! The run: kills processes, starts them again and checks the topics; at the end waits for the
//! recovery and counts leaks.

use std::collections::BTreeSet;
use std::io;
use std::thread;
use std::time::{Duration, Instant};

use conduit_ring::{Publisher, PublisherOptions, clock};
use program::stop::Stop;
use program::{Failure, Log};

use crate::fault::{self, Fault};
use crate::half_written::HalfWritten;
use crate::leaks;
use crate::plan::{self, Behaviour, LONG_MESSAGE, PublishedBy, Role, TOPICS};
use crate::processes::{Process, Processes};
use crate::random::Random;
use crate::report::Report;

/// The settings of a run.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The number of processes to kill.
    pub kills: u64,
    /// The seed of the random choices.
    pub seed: u64,
    /// The command that starts a BEAM node; empty for a run without nodes.
    pub node_command: Vec<String>,
    /// The time in which a topic with a live publisher and reader must deliver a message. Twice
    /// that time after the last kill, because BEAM nodes start in it.
    pub patience: Duration,
    /// A fault to inject, which the run must find.
    pub inject: Option<Fault>,
}

/// The average pause between two kills.
const KILL_INTERVAL: Duration = Duration::from_millis(40);
/// The longest pause before a killed process is started again.
const RESTART_PAUSE: Duration = Duration::from_millis(40);
/// The longest time after which some new processes are killed again, while they open their topic.
const EARLY_KILL: Duration = Duration::from_millis(4);
/// The longest wait for a long message, so that its publisher is killed while it writes.
const AIM: Duration = Duration::from_millis(400);
const CHECK_PERIOD: Duration = Duration::from_millis(10);
const PROGRESS_PERIOD: Duration = Duration::from_secs(10);
/// A node is killed this many times less often than a native process, because it starts slower
/// than all others together.
const NODE_IN: u64 = 2;
/// The topic of injected faults.
const VICTIM: usize = 0;

/// Runs to the end or the stop.
pub fn run(settings: &Settings, stop: &Stop, log: Log) -> Result<Report, Failure> {
    let processes = Processes::new(settings.node_command.clone(), log).map_err(runtime)?;
    let mut run = Run {
        random: Random::new(settings.seed),
        processes,
        settings,
        kills: 0,
        node_kills: 0,
        half_written: HalfWritten::default(),
        stuck: BTreeSet::new(),
        intruder: None,
        started: Instant::now(),
        next_progress: Instant::now() + PROGRESS_PERIOD,
        log,
    };
    run.prepare();
    run.kill_and_restart(stop).map_err(runtime)?;
    let recovered = run.await_recovery().map_err(runtime)?;
    let leaked = run.count_leaked()?;
    Ok(run.report(recovered, leaked))
}

struct Run<'a> {
    random: Random,
    processes: Processes,
    settings: &'a Settings,
    kills: u64,
    node_kills: u64,
    half_written: HalfWritten,
    stuck: BTreeSet<usize>,
    /// The publisher that blocks a topic, for an injected fault.
    intruder: Option<Publisher>,
    started: Instant,
    next_progress: Instant,
    log: Log,
}

impl Run<'_> {
    fn prepare(&mut self) {
        if self.settings.inject == Some(Fault::Torn) {
            for process in &mut self.processes.all {
                process.corrupt = process.role == Role::Publisher(VICTIM);
            }
        }
    }

    /// Kills and restarts processes until the number of kills is reached.
    fn kill_and_restart(&mut self, stop: &Stop) -> io::Result<()> {
        let mut next_kill = Instant::now() + 10 * KILL_INTERVAL;
        let mut next_check = Instant::now();
        let mut early_kills: Vec<(Instant, usize)> = Vec::new();
        while self.kills < self.settings.kills && !stop.requested() {
            let now = Instant::now();
            early_kills.extend(self.start_due(now)?);
            if let Some(at) = early_kills.iter().position(|(when, _)| *when <= now) {
                let (_, index) = early_kills.swap_remove(at);
                self.kill(index)?;
            } else if now >= next_kill {
                let index = self.victim();
                self.kill(index)?;
                next_kill = now + self.random.up_to(2 * KILL_INTERVAL);
            }
            if now >= next_check {
                self.check()?;
                next_check = Instant::now() + CHECK_PERIOD;
            }
            let next = early_kills.iter().map(|(when, _)| *when).min();
            let wake = next.map_or(next_kill, |next| next.min(next_kill));
            let wake = self.next_start().map_or(wake, |due| due.min(wake));
            thread::sleep(
                wake.min(next_check)
                    .saturating_duration_since(Instant::now()),
            );
        }
        Ok(())
    }

    /// Starts the processes that are due. Returns those that are to be killed early, and when.
    fn start_due(&mut self, now: Instant) -> io::Result<Vec<(Instant, usize)>> {
        let mut early_kills = Vec::new();
        for index in 0..self.processes.all.len() {
            let process = &self.processes.all[index];
            if process.life.is_none() && process.due <= now {
                let role = process.role;
                self.processes.start(index, &mut self.random)?;
                if !role.is_node() && self.random.one_in(4) {
                    early_kills.push((Instant::now() + self.random.up_to(EARLY_KILL), index));
                }
            }
        }
        Ok(early_kills)
    }

    fn next_start(&self) -> Option<Instant> {
        let is_stopped = |process: &&Process| process.life.is_none();
        self.processes
            .all
            .iter()
            .filter(is_stopped)
            .map(|process| process.due)
            .min()
    }

    fn victim(&mut self) -> usize {
        loop {
            let index = self.random.below(self.processes.all.len() as u64) as usize;
            if !self.processes.all[index].role.is_node() || self.random.one_in(NODE_IN) {
                return index;
            }
        }
    }

    fn kill(&mut self, index: usize) -> io::Result<()> {
        if self.processes.all[index].life.is_none() {
            return Ok(());
        }
        let role = self.processes.all[index].role;
        let written = plan::topics(self.processes.with_nodes())
            .map(|(topic, _)| topic)
            .find(|&topic| role.publishes(topic));
        if let Some(topic) = written
            && TOPICS[topic].slot_size as usize > LONG_MESSAGE
            && !self.random.one_in(4)
        {
            let topic = self.processes.topic(topic).map_err(io::Error::other)?;
            self.half_written.wait(&topic, AIM);
        }
        self.processes.kill(index)?;
        self.kills += 1;
        self.node_kills += u64::from(role.is_node());
        if let Some(topic) = written {
            let topic = self.processes.topic(topic).map_err(io::Error::other)?;
            self.half_written.record(&topic);
        }
        if role == Role::Publisher(VICTIM) {
            self.inject_after_kill()?;
        }
        let pause = if self.random.one_in(2) {
            Duration::ZERO
        } else {
            self.random.up_to(RESTART_PAUSE)
        };
        self.processes.all[index].due = Instant::now() + pause;
        Ok(())
    }

    fn check(&mut self) -> io::Result<()> {
        self.processes.read_logs()?;
        self.processes.restart_ended(self.settings.patience)?;
        let now_ns = clock::now_ns();
        for (topic, plan) in plan::topics(self.processes.with_nodes()) {
            let silence = match self.processes.judge.newest(topic as u32) {
                Some(newest) => Duration::from_nanos(now_ns.saturating_sub(newest)),
                None => self.started.elapsed(),
            };
            let undisturbed = self.processes.undisturbed(topic).unwrap_or_default();
            if silence.min(undisturbed) > self.settings.patience && self.stuck.insert(topic) {
                self.log.line(format!("topic {} is stuck", plan.label));
            }
        }
        self.log_progress();
        Ok(())
    }

    fn log_progress(&mut self) {
        if Instant::now() < self.next_progress {
            return;
        }
        self.next_progress += PROGRESS_PERIOD;
        let judge = &self.processes.judge;
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

    /// Starts all processes once more and waits until each reader has a message that was
    /// published after the last kill. Returns the time that it took.
    fn await_recovery(&mut self) -> io::Result<Duration> {
        let last_kill = Instant::now();
        let last_kill_ns = clock::now_ns();
        self.end(is_restless_reader)?;
        loop {
            let now = Instant::now();
            for index in 0..self.processes.all.len() {
                let process = &self.processes.all[index];
                if process.life.is_none()
                    && !is_restless_reader(process.role)
                    && process.due <= now
                {
                    self.processes.start(index, &mut self.random)?;
                }
            }
            self.processes.read_logs()?;
            self.processes.restart_ended(2 * self.settings.patience)?;
            let silent: Vec<usize> = plan::topics(self.processes.with_nodes())
                .map(|(topic, _)| topic)
                .filter(|&topic| !self.processes.flows(topic, last_kill_ns))
                .collect();
            if silent.is_empty() || last_kill.elapsed() > 2 * self.settings.patience {
                for topic in silent {
                    self.log
                        .line(format!("topic {} did not recover", TOPICS[topic].label));
                    self.stuck.insert(topic);
                }
                return Ok(last_kill.elapsed());
            }
            thread::sleep(CHECK_PERIOD);
        }
    }

    /// Ends processes whose restarts would disturb the count. These do not count as kills.
    fn end(&mut self, which: impl Fn(Role) -> bool) -> io::Result<()> {
        for index in 0..self.processes.all.len() {
            if which(self.processes.all[index].role) {
                self.processes.kill(index)?;
            }
        }
        Ok(())
    }

    fn count_leaked(&mut self) -> Result<u64, Failure> {
        let restless = PublishedBy::Native(Behaviour::Restless);
        let has_restless = |role| match role {
            Role::Publisher(topic) => TOPICS[topic].published_by == restless,
            _ => false,
        };
        self.end(has_restless).map_err(runtime)?;
        if self.settings.inject == Some(Fault::Leaked) {
            fault::mark_slot(&self.processes.topic(VICTIM).map_err(runtime)?).map_err(runtime)?;
        }
        let mut leaked = 0;
        for (topic, plan) in plan::topics(self.processes.with_nodes()) {
            let name = self.processes.topic(topic).map_err(runtime)?;
            let patience = self.settings.patience;
            let count = leaks::count(&name, patience, || {
                // A reader that ended by itself is a fault of its own.
                self.processes.restart_ended(patience)?;
                Ok(self.processes.live_readers(topic))
            });
            let count = count.map_err(runtime)?;
            if count != 0 {
                let label = plan.label;
                self.log
                    .line(format!("topic {label} lacks {count} reader slots"));
            }
            leaked += count;
        }
        Ok(leaked)
    }

    fn inject_after_kill(&mut self) -> io::Result<()> {
        let topic = self.processes.topic(VICTIM).map_err(io::Error::other)?;
        match self.settings.inject {
            Some(Fault::Reused) => fault::decrement_published(&topic),
            Some(Fault::Stuck) if self.intruder.is_none() => {
                let options = PublisherOptions {
                    geometry: TOPICS[VICTIM].geometry(0).map_err(io::Error::other)?,
                    ..PublisherOptions::default()
                };
                self.intruder = Publisher::open(&topic, &options).ok();
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn report(&self, recovered: Duration, leaked: u64) -> Report {
        let judge = &self.processes.judge;
        let ended = &self.processes.ended;
        for finding in &judge.findings {
            self.log.line(finding);
        }
        Report {
            seed: self.settings.seed,
            kills: self.kills,
            node_kills: self.node_kills,
            half_written: self.half_written.count(),
            messages: judge.messages,
            torn: judge.torn,
            stuck: self.stuck.len().max(usize::from(!ended.is_empty())) as u64,
            leaked,
            reused: judge.reused,
            unreported: judge.unreported,
            seconds: self.started.elapsed().as_secs(),
            recovery_ms: recovered.as_millis() as u64,
        }
    }
}

fn is_restless_reader(role: Role) -> bool {
    matches!(role, Role::Reader(_, Behaviour::Restless))
}

fn runtime(error: impl std::fmt::Display) -> Failure {
    Failure::Runtime(error.to_string())
}
