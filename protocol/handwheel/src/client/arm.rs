//! The session of ARCOS around a Pioneer Arm: opened if nobody has, and then closed.
//!
//! A session that another host has open is used as it is, and left open: CLOSE would send its arm home.

use protocol::arcos::{
    ArmCommand, ArmInfo, ArmStatus, Dialect, JointInfo, Joints, Names, Packet, SYNC, Standard,
    StatusRequest, command,
};

use super::Client;
use crate::error::Error;
use crate::session::{Event, Personality, Reply};
use crate::settings::dialect;

/// What is open.
pub(super) struct Opened {
    is_ours: bool,
    name: Option<[String; 3]>,
    /// How its state is read, once that was asked; in force since the arm's start.
    dialect: Option<Dialect>,
}

/// A Pioneer Arm, told in full.
#[derive(Clone, Debug, PartialEq)]
pub struct Arm {
    /// Robot, class and subclass, if the session is ours; another host has asked otherwise.
    pub names: Option<[String; 3]>,
    /// Its version, `None` without an arm.
    pub version: Option<String>,
    /// Its joints 1 to 6, positions in ticks.
    pub joints: [JointInfo; 6],
    /// Its state.
    pub status: ArmStatus,
}

impl Client {
    /// Whether another host has the session open.
    pub fn is_guest(&self) -> bool {
        self.arm.as_ref().is_some_and(|opened| !opened.is_ours)
    }

    pub(super) fn open_arm(&mut self) -> Result<(), Error> {
        // What tells that it is an arm may be a standard packet: then a session is open.
        let is_open = |client: &mut Self| {
            let mut found = false;
            while let Some(event) = client.session.take_event() {
                found |= matches!(event, Event::Standard(_));
            }
            found
        };
        if is_open(self) {
            self.arm = Some(Opened { is_ours: false, name: None, dialect: None });
            return Ok(());
        }
        let mut name = None;
        for sync in SYNC {
            let reply = self.packet(&sync, sync.id, "a session")?;
            if let Reply::Packet(id, data) = &reply
                && let Some(names) = Names::parse(&Packet { id: *id, data })
            {
                name = Some([names.name, names.class, names.subclass].map(str::to_owned));
            }
        }
        self.arm = Some(Opened { is_ours: true, name, dialect: None });
        self.packet(&Packet { id: command::OPEN, data: &[] }, Standard::ID, "a session").map(drop)
    }

    pub(super) fn close_arm(&mut self) {
        if self.arm.take().is_some_and(|opened| opened.is_ours) {
            let close = Packet { id: command::CLOSE, data: &[] };
            // The link may be gone; then a session ends by silence.
            let _ = self.session.packet(&close, None, self.now());
            let _ = self.pump(std::time::Duration::ZERO);
        }
    }

    /// All about an arm.
    ///
    /// # Errors
    /// As all requests; [`Error::NotCarried`] by other boards.
    pub fn arm(&mut self) -> Result<Arm, Error> {
        let reply = self.arm_command(ArmCommand::Info, ArmInfo::ID, "its arm")?;
        let (mut version, mut joints) = (None, [JointInfo::default(); 6]);
        if let Reply::Packet(id, data) = &reply
            && let Some(ArmInfo::Arm { version: v, joints: j }) =
                ArmInfo::parse(&Packet { id: *id, data })
        {
            (version, joints) = (Some(v.to_owned()), j);
        }
        let status = self.arm_status()?;
        let names = self.arm.as_ref().and_then(|opened| opened.name.clone());
        Ok(Arm { names, version, joints, status })
    }

    /// The arm's state, read in the dialect that its settings say.
    ///
    /// # Errors
    /// As all requests.
    pub fn arm_status(&mut self) -> Result<ArmStatus, Error> {
        let known = self.arm.as_ref().and_then(|opened| opened.dialect);
        let dialect = match known {
            Some(dialect) => dialect,
            None => dialect(self.setting("arm dialect").ok().map(|setting| setting.value)),
        };
        if let Some(opened) = &mut self.arm {
            opened.dialect = Some(dialect);
        }
        let what = "its arm's state";
        let once = ArmCommand::Status(StatusRequest::Once);
        match self.arm_command(once, ArmStatus::ID, what)? {
            Reply::Packet(id, data) => {
                let status = ArmStatus::parse(&Packet { id, data: &data }, dialect);
                status.ok_or(Error::NoAnswer(what))
            }
            _ => Err(Error::NoAnswer(what)),
        }
    }

    /// What another host's session tells of the arm within this time, without a question of ours.
    ///
    /// # Errors
    /// [`Error::Gone`].
    pub fn overheard_arm(
        &mut self,
        time: std::time::Duration,
        dialect: Dialect,
    ) -> Result<Option<ArmStatus>, Error> {
        let end = self.now() + time;
        while self.now() < end {
            while let Some(event) = self.session.take_event() {
                if let Event::Packet(id, data) = event
                    && let Some(status) = ArmStatus::parse(&Packet { id, data: &data }, dialect)
                {
                    return Ok(Some(status));
                }
            }
            self.pump(super::TICK)?;
        }
        Ok(None)
    }

    /// Stops all joints where they are; whether none moves any more.
    ///
    /// # Errors
    /// As all requests.
    pub(super) fn stop_arm(&mut self) -> Result<bool, Error> {
        let sent = self.session.arm(ArmCommand::Stop(Joints::All), None, self.now());
        sent.map_err(|failure| self.failed(failure, "a stop"))?;
        Ok(self.arm_status()?.moving == [false; 6])
    }

    fn arm_command(
        &mut self,
        command: ArmCommand,
        answer: u8,
        what: &'static str,
    ) -> Result<Reply, Error> {
        if self.personality() != Personality::Arcos {
            return Err(Error::NotCarried(self.personality(), "arm", ""));
        }
        let begun = self.session.arm(command, Some(answer), self.now());
        begun.map_err(|failure| self.failed(failure, what))?;
        self.wait(what)
    }

    fn packet(
        &mut self,
        packet: &Packet<'_>,
        answer: u8,
        what: &'static str,
    ) -> Result<Reply, Error> {
        let begun = self.session.packet(packet, Some(answer), self.now());
        begun.map_err(|failure| self.failed(failure, what))?;
        self.wait(what)
    }
}
