//! Answers that were just computed, kept as long as what they are made of is the newest: who asks for the same again is not
//! computed anew. Bounded in number and bytes.

use super::conditional::Tag;
use axum::body::Bytes;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Answers kept, and bytes of them.
const MAX_KEPT: usize = 64;
const MAX_BYTES: usize = 16 << 20;

/// Askers of different answers wait for each other only if they share one of so many gates.
const GATES: usize = 16;

/// What was asked, and of which state of the data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Key {
    /// Path and query.
    pub(super) asked: String,
    /// Samples received of the channel.
    pub(super) received: u64,
    /// By how many samples an answer may be behind for who asks while the next one is computed.
    pub(super) behind: u64,
}

impl Key {
    fn may_have(&self, made: &Self) -> bool {
        self.asked == made.asked && self.received.abs_diff(made.received) <= self.behind
    }
}

/// An answer and its tag; cheap to clone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Answer {
    pub(super) body: Bytes,
    pub(super) tag: Tag,
}

impl Answer {
    fn of(body: Bytes) -> Self {
        Self { tag: Tag::of(&body), body }
    }
}

/// The answers; cheap to clone.
#[derive(Debug, Clone)]
pub(super) struct Recent {
    kept: Arc<Mutex<VecDeque<(Key, Answer)>>>,
    gates: Arc<[tokio::sync::Mutex<()>; GATES]>,
}

impl Default for Recent {
    fn default() -> Self {
        Self {
            kept: Arc::default(),
            gates: Arc::new(std::array::from_fn(|_| tokio::sync::Mutex::new(()))),
        }
    }
}

impl Recent {
    /// The answer that is kept, or that `compute` gives. Who asks meanwhile gets the one before, where it is hardly older, or
    /// waits: a shard that is just judging a window answers one question later, not all of them.
    pub(super) async fn answer<E>(
        &self,
        key: Key,
        compute: impl Future<Output = Result<Bytes, E>>,
    ) -> Result<Answer, E> {
        if let Some(found) = self.find(&key) {
            return Ok(found);
        }
        let gate =
            key.asked.bytes().fold(0_usize, |sum, byte| sum.wrapping_mul(31) ^ usize::from(byte));
        let Some(gate) = self.gates.get(gate % GATES) else {
            return Ok(Answer::of(compute.await?));
        };
        let _turn = match gate.try_lock() {
            Ok(turn) => turn,
            Err(_) => match self.before(&key) {
                Some(found) => return Ok(found),
                None => gate.lock().await,
            },
        };
        if let Some(found) = self.find(&key) {
            return Ok(found);
        }
        let made = Answer::of(compute.await?);
        self.keep(key, made.clone());
        Ok(made)
    }

    fn find(&self, key: &Key) -> Option<Answer> {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().find(|(one, _)| one == key).map(|(_, answer)| answer.clone())
    }

    /// The answer before the one to a question, if it is hardly older.
    fn before(&self, key: &Key) -> Option<Answer> {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().find(|(made, _)| key.may_have(made)).map(|(_, answer)| answer.clone())
    }

    /// Keeps an answer instead of an older one to the same question; the oldest give way.
    fn keep(&self, key: Key, answer: Answer) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|(one, _)| one.asked != key.asked);
        kept.push_back((key, answer));
        let mut bytes: usize = kept.iter().map(|(_, answer)| answer.body.len()).sum();
        while kept.len() > MAX_KEPT || bytes > MAX_BYTES {
            let gone = kept.pop_front();
            bytes -= gone.map_or(bytes, |(_, answer)| answer.body.len());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn key(asked: &str, received: u64) -> Key {
        Key { asked: asked.to_owned(), received, behind: 0 }
    }

    #[tokio::test]
    async fn who_asks_while_the_next_is_computed_gets_the_one_before_if_it_is_hardly_older() {
        let recent = Recent::default();
        let ask = |received: u64,
                   answer: &'static str,
                   slow: Option<tokio::sync::oneshot::Receiver<()>>| {
            let key = Key { behind: 5, ..key("x", received) };
            let compute = async move {
                if let Some(slow) = slow {
                    slow.await.unwrap();
                }
                Ok::<_, Infallible>(Bytes::from(answer))
            };
            let answer = recent.answer(key, compute);
            async move { answer.await.unwrap().body }
        };
        assert_eq!(ask(10, "first", None).await, "first");
        let (finish, slow) = tokio::sync::oneshot::channel();
        let next = ask(15, "second", Some(slow));
        let meanwhile = async {
            let before = ask(15, "not computed", None).await;
            finish.send(()).unwrap();
            before
        };
        assert_eq!(tokio::join!(next, meanwhile), ("second".into(), "first".into()));
        let (finish, slow) = tokio::sync::oneshot::channel();
        let next = ask(21, "third", Some(slow));
        let too_old = ask(21, "not computed", None);
        let finishing = async { finish.send(()).unwrap() };
        assert_eq!(tokio::join!(next, too_old, finishing), ("third".into(), "third".into(), ()));
    }

    #[tokio::test]
    async fn what_is_asked_again_is_computed_once_until_more_has_come() {
        let (recent, n) = (Recent::default(), AtomicUsize::new(0));
        let (recent, n) = (&recent, &n);
        let ask = |asked: &'static str, received: u64| {
            let compute = async move {
                n.fetch_add(1, Ordering::Relaxed);
                tokio::task::yield_now().await;
                Ok::<_, Infallible>(Bytes::from(format!("{asked} {received}")))
            };
            async move {
                let answer = recent.answer(key(asked, received), compute).await;
                answer.map(|answer| answer.body)
            }
        };
        let (a, b, c) = tokio::join!(ask("x", 1), ask("x", 1), ask("y", 1));
        assert_eq!(
            (a.unwrap(), b.unwrap(), c.unwrap()),
            ("x 1".into(), "x 1".into(), "y 1".into())
        );
        assert_eq!(n.load(Ordering::Relaxed), 2, "those who ask together are answered by one");
        assert_eq!(ask("x", 2).await.unwrap(), "x 2");
        assert_eq!((ask("x", 2).await.unwrap(), n.load(Ordering::Relaxed)), ("x 2".into(), 3));
        assert_eq!(recent.kept.lock().unwrap().len(), 2, "one a question");
    }

    #[tokio::test]
    async fn what_is_kept_is_bounded_and_failures_are_not_kept() {
        let recent = Recent::default();
        let large = Bytes::from(vec![0; 1 << 20]);
        for n in 0..100 {
            let answer = async { Ok::<_, Infallible>(large.clone()) };
            recent.answer(key(&n.to_string(), 0), answer).await.unwrap();
        }
        assert_eq!(recent.kept.lock().unwrap().len(), 16);
        let failed = recent.answer(key("bad", 0), async { Err("busy") }).await;
        assert_eq!((failed, recent.find(&key("bad", 0))), (Err("busy"), None));
    }
}
