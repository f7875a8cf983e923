//! The page: `handwheel`'s, on a thread of its own. It is one more host of the board's TCP line; the world it asks
//! by questions to the main loop, as the inspector's clients do.

use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::time::Duration;

use hal_mock::machine::{Machine, ask};
use handwheel::Link;
use handwheel::web::{self, Serve};
use serde_json::Value;

use crate::door::Address;
use crate::links::Links;

/// How long a question waits for the main loop.
const PATIENCE: Duration = Duration::from_secs(1);

type Answer = Result<Value, String>;

/// The page that is served.
pub struct Page {
    questions: Receiver<(Value, SyncSender<Answer>)>,
    place: String,
}

impl Page {
    /// Serves it for the board at this address, until `end`; or says in one line why not.
    pub fn open(
        address: Address<'_>,
        board: SocketAddr,
        end: Arc<AtomicBool>,
    ) -> Result<Self, String> {
        let (listen, place) = address.listen(|address| {
            let listener = TcpListener::bind(address)?;
            let place = listener.local_addr()?;
            Ok((listener, place))
        })?;
        let (ask, questions) = channel();
        let world = move |question: &Value| {
            let (tell, answer) = sync_channel(1);
            let gone = "the board is ending";
            ask.send((question.clone(), tell)).map_err(|_| gone.to_owned())?;
            answer.recv_timeout(PATIENCE).map_err(|_| gone.to_owned())?
        };
        let link = Link::Tcp(board.to_string());
        let serving = Serve { listen, link, names: Vec::new(), world: Some(Box::new(world)) };
        let page = web::serve(serving, end).map_err(|error| error.to_string())?;
        // Behind the address may stand why it is another one.
        let why = place.split_once(',').map_or(String::new(), |(_, why)| format!(",{why}"));
        Ok(Self { questions, place: format!("{}{why}", page.address) })
    }

    /// Where it is, for the user.
    pub fn place(&self) -> String {
        format!("page {}", self.place)
    }

    /// Answers what was asked about the world.
    pub fn serve(&self, machine: &mut dyn Machine, links: &Links) {
        for (question, tell) in self.questions.try_iter() {
            // Whoever has asked may have gone.
            let _ = tell.try_send(ask(&question, machine, || links.state()));
        }
    }
}
