//! The processes of a run: started, killed, started again; and their logs, which outlive them.

use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use conduit_ring::{Error, Topic};
use program::Log;

use crate::judge::{Judge, Life};
use crate::plan::{self, LINES, Manner, Role};
use crate::random::Random;
use crate::record::Tail;

/// One process of the plan: running, or due to be started again.
pub struct Actor {
    /// What it does.
    pub role: Role,
    /// Its present life.
    pub life: Option<Running>,
    /// When it is started, if it does not run.
    pub due: Instant,
    /// Whether its publisher spoils messages, for a run that must fail.
    pub corrupt: bool,
}

/// A life of a process.
pub struct Running {
    /// When it was started.
    pub since: Instant,
    /// What the judge calls it.
    pub name: Life,
    child: Child,
    tail: Option<Tail>,
}

/// See the module.
pub struct Stage {
    /// All processes.
    pub actors: Vec<Actor>,
    /// What the subscribers' notes come to.
    pub judge: Judge,
    /// Processes that ended by themselves, in words: each needs a human.
    pub ended: Vec<String>,
    folder: PathBuf,
    prefix: String,
    node_command: Vec<String>,
    lives: u64,
    log: Log,
}

impl Stage {
    /// A stage with nobody on it yet. Without a command for BEAM nodes there are none.
    pub fn new(node_command: Vec<String>, log: Log) -> io::Result<Stage> {
        // The tests' run, which finds by its name what was left behind.
        let run = std::env::var("GANGLION_RUN").unwrap_or_else(|_| "run".into());
        let prefix = format!("chaos.{run}.{}", std::process::id());
        let folder = std::env::temp_dir().join(format!("ganglion-{prefix}"));
        std::fs::create_dir(&folder)?;
        let now = Instant::now();
        let actor = |role| Actor {
            role,
            life: None,
            due: now,
            corrupt: false,
        };
        let roles = Role::all(!node_command.is_empty());
        Ok(Stage {
            actors: roles.into_iter().map(actor).collect(),
            judge: Judge::default(),
            ended: Vec::new(),
            folder,
            prefix,
            node_command,
            lives: 0,
            log,
        })
    }

    /// Whether BEAM nodes take part.
    pub fn with_nodes(&self) -> bool {
        !self.node_command.is_empty()
    }

    /// A topic of the plan.
    pub fn topic(&self, number: usize) -> Result<Topic, Error> {
        Topic::new(&self.topic_name(number))
    }

    fn topic_name(&self, number: usize) -> String {
        format!("{}-{}", self.prefix, LINES[number].label)
    }

    /// Starts an actor that does not run.
    pub fn start(&mut self, index: usize, random: &mut Random) -> io::Result<()> {
        self.lives += 1;
        let name = Life(self.lives);
        let Actor { role, corrupt, .. } = self.actors[index];
        let path = self.folder.join(self.lives.to_string());
        let tail = match role {
            Role::Publisher(_) => None,
            Role::Reader(..) | Role::Node(_) => Some(Tail::create(&path)?),
        };
        let mut command = match role {
            Role::Node(node) => self.node(node, &path),
            Role::Publisher(topic) => self.publisher(topic, corrupt)?,
            Role::Reader(topic, manner) => self.reader(topic, manner, &path)?,
        };
        let seed = random.next().to_string();
        let child = command
            .env("CHAOS_SEED", seed)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()?;
        self.actors[index].life = Some(Running {
            since: Instant::now(),
            name,
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

    fn reader(&self, topic: usize, manner: Manner, log: &Path) -> io::Result<Command> {
        let mut command = Command::new(std::env::current_exe()?);
        command.arg("subscribe").args(self.names(topic));
        command.arg("--log").arg(log);
        match manner {
            Manner::Steady => {}
            Manner::Restless => _ = command.arg("--restless"),
            Manner::Leasing => _ = command.arg("--leasing"),
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

    /// What the node is to do stands in its environment: `number:name:slot_count:slot_size:burst:pause_ms` for each topic.
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
            .env("CHAOS_PUBLISH", self.lines(publishes.iter().copied()))
            .env("CHAOS_SUBSCRIBE", self.lines(reads));
        command
    }

    fn lines(&self, topics: impl Iterator<Item = usize>) -> String {
        let texts: Vec<String> = topics
            .map(|topic| {
                let line = &LINES[topic];
                format!(
                    "{topic}:{}:{}:{}:{}:{}",
                    self.topic_name(topic),
                    line.slot_count,
                    line.slot_size,
                    line.burst,
                    line.pause.as_millis()
                )
            })
            .collect();
        texts.join(" ")
    }

    /// Kills a running actor with SIGKILL and reads what it noted to the end.
    pub fn kill(&mut self, index: usize) -> io::Result<()> {
        let actor = &mut self.actors[index];
        let Some(mut life) = actor.life.take() else {
            return Ok(());
        };
        life.child.kill()?;
        life.child.wait()?;
        read(actor.role, &mut life, &mut self.judge)?;
        self.judge.bury(life.name);
        Ok(())
    }

    /// Reads what all have noted meanwhile.
    pub fn read_logs(&mut self) -> io::Result<()> {
        for actor in &mut self.actors {
            if let Some(life) = &mut actor.life {
                read(actor.role, life, &mut self.judge)?;
            }
        }
        Ok(())
    }

    /// Looks for processes that ended by themselves; they are started again after `pause`.
    pub fn look_for_ended(&mut self, pause: Duration) -> io::Result<()> {
        for index in 0..self.actors.len() {
            let Some(life) = &mut self.actors[index].life else {
                continue;
            };
            if let Some(status) = life.child.try_wait()? {
                let text = format!("{:?} ended by itself: {status}", self.actors[index].role);
                self.log.line(&text);
                self.ended.push(text);
                self.kill(index)?;
                self.actors[index].due = Instant::now() + pause;
            }
        }
        Ok(())
    }

    /// Whether every reader of a topic has accepted a message published after `since_ns`.
    pub fn flows(&self, topic: usize, since_ns: u64) -> bool {
        let reached = |life: &Running| {
            self.judge
                .newest_of(life.name, topic as u32)
                .is_some_and(|at| at > since_ns)
        };
        self.actors
            .iter()
            .filter(|actor| actor.role.reads(topic))
            .all(|actor| actor.life.as_ref().is_some_and(reached))
    }

    /// For how long a topic's publisher and at least one of its readers have lived without a break.
    pub fn undisturbed(&self, topic: usize) -> Option<Duration> {
        let longest = |takes_part: &dyn Fn(Role) -> bool| {
            self.actors
                .iter()
                .filter(|actor| takes_part(actor.role))
                .filter_map(|actor| actor.life.as_ref())
                .map(|life| life.since.elapsed())
                .max()
        };
        let publisher = longest(&|role| role.publishes(topic))?;
        let reader = longest(&|role| role.reads(topic))?;
        Some(publisher.min(reader))
    }
}

fn read(role: Role, life: &mut Running, judge: &mut Judge) -> io::Result<()> {
    let Some(tail) = &mut life.tail else {
        return Ok(());
    };
    for record in tail.news()? {
        judge.take(life.name, role.in_order(), &record);
    }
    Ok(())
}

impl Drop for Stage {
    fn drop(&mut self) {
        for index in 0..self.actors.len() {
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
