//! The processes of a run and their logs, which outlive them.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use conduit_ring::{Error, Topic};
use program::Log;

use crate::judge::{Judge, Life};
use crate::plan::{self, Behaviour, Role, TOPICS};
use crate::random::Random;
use crate::record::Tail;

/// A process of the plan: running, or due to be started again.
pub struct Process {
    /// The role of the process.
    pub role: Role,
    /// The current life, if the process runs.
    pub life: Option<Running>,
    /// The time of the next start, if the process does not run.
    pub due: Instant,
    /// Whether the publisher corrupts messages, for an injected fault.
    pub corrupt: bool,
}

/// A life of a process.
pub struct Running {
    /// The time of the start.
    pub since: Instant,
    /// The life's number for the judge.
    pub id: Life,
    child: Child,
    tail: Option<Tail>,
}

/// The processes of a run.
pub struct Processes {
    /// All processes.
    pub all: Vec<Process>,
    /// The judge of the readers' records.
    pub judge: Judge,
    /// Descriptions of processes that ended by themselves, which is a fault.
    pub ended: Vec<String>,
    folder: PathBuf,
    prefix: String,
    node_command: Vec<String>,
    lives: u64,
    log: Log,
}

impl Processes {
    /// Returns the processes, not started yet. Without a command for BEAM nodes there are none.
    pub fn new(node_command: Vec<String>, log: Log) -> io::Result<Processes> {
        // The name of the tests' run, by which leftovers are found.
        let run = std::env::var("GANGLION_RUN").unwrap_or_else(|_| "run".into());
        let prefix = format!("chaos.{run}.{}", std::process::id());
        let folder = std::env::temp_dir().join(format!("ganglion-{prefix}"));
        std::fs::create_dir(&folder)?;
        let now = Instant::now();
        let process = |role| Process {
            role,
            life: None,
            due: now,
            corrupt: false,
        };
        let roles = Role::all(!node_command.is_empty());
        Ok(Processes {
            all: roles.into_iter().map(process).collect(),
            judge: Judge::default(),
            ended: Vec::new(),
            folder,
            prefix,
            node_command,
            lives: 0,
            log,
        })
    }

    /// Returns whether BEAM nodes take part.
    pub fn with_nodes(&self) -> bool {
        !self.node_command.is_empty()
    }

    /// Returns a topic of the plan.
    pub fn topic(&self, number: usize) -> Result<Topic, Error> {
        Topic::new(&self.topic_name(number))
    }

    fn topic_name(&self, number: usize) -> String {
        format!("{}-{}", self.prefix, TOPICS[number].label)
    }

    /// Starts a process that does not run.
    pub fn start(&mut self, index: usize, random: &mut Random) -> io::Result<()> {
        self.lives += 1;
        let id = Life(self.lives);
        let Process { role, corrupt, .. } = self.all[index];
        let path = self.folder.join(self.lives.to_string());
        let tail = match role {
            Role::Publisher(_) => None,
            Role::Reader(..) | Role::Node(_) => Some(Tail::create(&path)?),
        };
        let mut command = match role {
            Role::Node(node) => self.node(node, &path),
            Role::Publisher(topic) => self.publisher(topic, corrupt)?,
            Role::Reader(topic, behaviour) => self.reader(topic, behaviour, &path)?,
        };
        let seed = random.next().to_string();
        let child = command
            .env("CHAOS_SEED", seed)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()?;
        self.all[index].life = Some(Running {
            since: Instant::now(),
            id,
            child,
            tail,
        });
        Ok(())
    }

    fn publisher(&self, topic: usize, corrupt: bool) -> io::Result<Command> {
        let mut command = Command::new(std::env::current_exe()?);
        command.arg("publish").args(self.names(topic));
        if corrupt {
            command.arg("--corrupt");
        }
        Ok(command)
    }

    fn reader(&self, topic: usize, behaviour: Behaviour, log: &Path) -> io::Result<Command> {
        let mut command = Command::new(std::env::current_exe()?);
        command.arg("subscribe").args(self.names(topic));
        command.arg("--log").arg(log);
        match behaviour {
            Behaviour::Steady => {}
            Behaviour::Restless => _ = command.arg("--restless"),
            Behaviour::Leasing => _ = command.arg("--leasing"),
        }
        Ok(command)
    }

    fn names(&self, topic: usize) -> [String; 4] {
        [
            "--number".into(),
            topic.to_string(),
            "--topic".into(),
            self.topic_name(topic),
        ]
    }

    /// Returns the command of a node, whose environment describes its topics:
    /// `number:name:slot_count:slot_size:burst:pause_ms` for each.
    fn node(&self, node: usize, log: &Path) -> Command {
        let role = Role::Node(node);
        let (publishes, reads): (Vec<_>, Vec<_>) = plan::topics(true)
            .map(|(topic, _)| topic)
            .filter(|&topic| role.publishes(topic) || role.reads(topic))
            .partition(|&topic| role.publishes(topic));
        let reads = reads.iter().chain(&publishes).copied();
        let mut command = Command::new(&self.node_command[0]);
        command
            .args(&self.node_command[1..])
            .env("CHAOS_LOG", log)
            .env("CHAOS_PUBLISH", self.describe(publishes.iter().copied()))
            .env("CHAOS_SUBSCRIBE", self.describe(reads));
        command
    }

    fn describe(&self, topics: impl Iterator<Item = usize>) -> String {
        let texts: Vec<String> = topics
            .map(|topic| {
                let plan = &TOPICS[topic];
                format!(
                    "{topic}:{}:{}:{}:{}:{}",
                    self.topic_name(topic),
                    plan.slot_count,
                    plan.slot_size,
                    plan.burst,
                    plan.pause.as_millis()
                )
            })
            .collect();
        texts.join(" ")
    }

    /// Kills a process with SIGKILL and reads the rest of its log.
    pub fn kill(&mut self, index: usize) -> io::Result<()> {
        let process = &mut self.all[index];
        let Some(mut life) = process.life.take() else {
            return Ok(());
        };
        life.child.kill()?;
        life.child.wait()?;
        read(process.role, &mut life, &mut self.judge)?;
        self.judge.remove(life.id);
        Ok(())
    }

    /// Reads the new records of all logs.
    pub fn read_logs(&mut self) -> io::Result<()> {
        for process in &mut self.all {
            if let Some(life) = &mut process.life {
                read(process.role, life, &mut self.judge)?;
            }
        }
        Ok(())
    }

    /// Reports processes that ended by themselves and restarts them after `pause`.
    pub fn restart_ended(&mut self, pause: Duration) -> io::Result<()> {
        for index in 0..self.all.len() {
            let Some(life) = &mut self.all[index].life else {
                continue;
            };
            if let Some(status) = life.child.try_wait()? {
                let text = format!("{:?} ended by itself: {status}", self.all[index].role);
                self.log.line(&text);
                self.ended.push(text);
                self.kill(index)?;
                self.all[index].due = Instant::now() + pause;
            }
        }
        Ok(())
    }

    /// Returns whether each reader of a topic has accepted a message published after `since_ns`.
    pub fn flows(&self, topic: usize, since_ns: u64) -> bool {
        let reached = |life: &Running| {
            self.judge
                .newest_of(life.id, topic as u32)
                .is_some_and(|at| at > since_ns)
        };
        self.all
            .iter()
            .filter(|process| process.role.reads(topic))
            .all(|process| process.life.as_ref().is_some_and(reached))
    }

    /// Returns how long a topic's publisher and at least one of its readers have been running.
    pub fn undisturbed(&self, topic: usize) -> Option<Duration> {
        let longest = |has_part: &dyn Fn(Role) -> bool| {
            self.all
                .iter()
                .filter(|process| has_part(process.role))
                .filter_map(|process| process.life.as_ref())
                .map(|life| life.since.elapsed())
                .max()
        };
        let publisher = longest(&|role| role.publishes(topic))?;
        let reader = longest(&|role| role.reads(topic))?;
        Some(publisher.min(reader))
    }

    /// Returns the running readers of a topic by their process numbers.
    pub fn live_readers(&self, topic: usize) -> BTreeSet<u32> {
        let readers = self.all.iter().filter(|process| process.role.reads(topic));
        let lives = readers.filter_map(|process| process.life.as_ref());
        lives.map(|life| life.child.id()).collect()
    }
}

fn read(role: Role, life: &mut Running, judge: &mut Judge) -> io::Result<()> {
    let Some(tail) = &mut life.tail else {
        return Ok(());
    };
    for record in tail.read_new()? {
        judge.check(life.id, role.in_order(), &record);
    }
    Ok(())
}

impl Drop for Processes {
    fn drop(&mut self) {
        for index in 0..self.all.len() {
            let _ = self.kill(index);
        }
        for (number, _) in plan::topics(true) {
            if let Ok(topic) = self.topic(number) {
                let _ = std::fs::remove_file(topic.path());
            }
        }
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
