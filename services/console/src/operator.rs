//! The thread that asks the supervisor: the link's client belongs to one thread and waits, the server does not.

use operator_link::{Answer, Client, LinkError, Request};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;
use table::Bench;
use tokio::sync::oneshot;

/// Requests that may wait; more are refused at once.
const QUEUE: usize = 64;
/// How long the supervisor may take.
const PATIENCE: Duration = Duration::from_millis(800);

type Asked = (Request, oneshot::Sender<Result<Answer, LinkError>>);

/// The end for the server's tasks.
#[derive(Clone)]
pub struct Operator {
    queue: SyncSender<Asked>,
}

impl Operator {
    /// Starts the thread; it ends when the last clone has gone.
    ///
    /// # Errors
    /// The system's, if there is no thread to be had.
    pub fn start(bench: Bench) -> std::io::Result<Self> {
        let (queue, asked) = sync_channel(QUEUE);
        std::thread::Builder::new().name("operator".to_owned()).spawn(move || serve(&bench, &asked))?;
        Ok(Operator { queue })
    }

    /// Asks and waits for the answer.
    ///
    /// # Errors
    /// In words: nobody there, no answer in time, too many requests.
    pub async fn ask(&self, request: Request) -> Result<Answer, String> {
        let (reply, answer) = oneshot::channel();
        self.queue.try_send((request, reply)).map_err(|error| match error {
            TrySendError::Full(_) => "too many requests at a time".to_owned(),
            TrySendError::Disconnected(_) => "the console is ending".to_owned(),
        })?;
        match answer.await {
            Ok(Ok(answer)) => Ok(answer),
            Ok(Err(error)) => Err(error.to_string()),
            Err(_) => Err("the console is ending".to_owned()),
        }
    }
}

fn serve(bench: &Bench, asked: &Receiver<Asked>) {
    let mut client: Option<Client> = None;
    while let Ok((request, reply)) = asked.recv() {
        // A bench that was started anew has a new link: the old client's failure is not the answer.
        let mut answer = match &client {
            Some(open) => open.ask(&request, PATIENCE),
            None => Err(LinkError::NobodyThere { bench: bench.name().as_str().to_owned() }),
        };
        // Asked again only where nobody can have heard it the first time.
        if matches!(answer, Err(LinkError::NobodyThere { .. } | LinkError::Transport(_))) {
            client = None;
            answer = Client::new(bench).and_then(|open| {
                let answer = open.ask(&request, PATIENCE);
                client = answer.is_ok().then_some(open);
                answer
            });
        }
        // Nobody waits any more when the page has gone.
        let _ = reply.send(answer);
    }
}
