//! The queue before a shard: items bounded in bytes, requests bounded in number.
//!
//! Items keep their order. Requests have a lane of their own, so that a question does not wait
//! behind seconds of samples; the lanes take turns, so neither starves the other.

use std::collections::VecDeque;
use std::fmt;
use std::sync::Condvar;
use std::sync::Mutex;
use std::sync::MutexGuard;
use std::sync::PoisonError;
use std::time::Instant;

/// The receiver is gone, or the daemon is stopping.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Closed;

/// Why a request was not taken; it comes back.
#[derive(Debug, PartialEq, Eq)]
pub enum Refused<T> {
    /// No room.
    Full(T),
    /// The receiver is gone.
    Closed(T),
}

/// What [`Queue::pop`] gives.
#[derive(Debug, PartialEq, Eq)]
pub enum Popped<T, R> {
    /// The oldest item.
    Item(T),
    /// The oldest request.
    Request(R),
    /// Nothing came until the deadline.
    Timeout,
    /// The queue is closed; what was left in it is dropped.
    Closed,
}

/// The queue.
pub struct Queue<T, R> {
    lanes: Mutex<Lanes<T, R>>,
    arrived: Condvar,
    freed: Condvar,
    max_bytes: usize,
    max_requests: usize,
}

struct Lanes<T, R> {
    items: VecDeque<(T, usize)>,
    bytes: usize,
    requests: VecDeque<R>,
    /// Whose turn it is when both lanes wait.
    request_next: bool,
    is_closed: bool,
}

impl<T, R> fmt::Debug for Queue<T, R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Queue")
            .field("bytes", &self.bytes())
            .field("max_bytes", &self.max_bytes)
            .finish_non_exhaustive()
    }
}

impl<T, R> Queue<T, R> {
    /// An empty queue. An item larger than `max_bytes` is taken only when no other is waiting.
    #[must_use]
    pub fn new(max_bytes: usize, max_requests: usize) -> Self {
        Self {
            lanes: Mutex::new(Lanes {
                items: VecDeque::new(),
                bytes: 0,
                requests: VecDeque::new(),
                request_next: true,
                is_closed: false,
            }),
            arrived: Condvar::new(),
            freed: Condvar::new(),
            max_bytes,
            max_requests,
        }
    }

    /// Puts an item in, waiting for room: back-pressure for sources that must not lose.
    ///
    /// # Errors
    /// When the queue is closed, also while waiting.
    pub fn push_wait(&self, item: T, bytes: usize) -> Result<(), Closed> {
        let mut lanes = self
            .freed
            .wait_while(self.lock(), |lanes| !lanes.is_closed && !self.has_room(lanes, bytes))
            .unwrap_or_else(PoisonError::into_inner);
        if lanes.is_closed {
            return Err(Closed);
        }
        lanes.put(item, bytes);
        drop(lanes);
        self.arrived.notify_one();
        Ok(())
    }

    /// Keeps room for items to come; false: there is none. It is used by [`Self::push_kept`].
    ///
    /// # Errors
    /// When the queue is closed.
    pub fn keep_room(&self, bytes: usize) -> Result<bool, Closed> {
        let mut lanes = self.lock();
        if lanes.is_closed {
            return Err(Closed);
        }
        let has_room = lanes.bytes == 0 || lanes.bytes.saturating_add(bytes) <= self.max_bytes;
        if has_room {
            lanes.bytes = lanes.bytes.saturating_add(bytes);
        }
        Ok(has_room)
    }

    /// Puts items in for which `kept` bytes were kept, each with its own.
    ///
    /// # Errors
    /// When the queue is closed.
    pub fn push_kept(
        &self,
        items: impl IntoIterator<Item = (T, usize)>,
        kept: usize,
    ) -> Result<(), Closed> {
        let mut lanes = self.lock();
        if lanes.is_closed {
            return Err(Closed);
        }
        lanes.bytes = lanes.bytes.saturating_sub(kept);
        for (item, bytes) in items {
            lanes.put(item, bytes);
        }
        drop(lanes);
        self.arrived.notify_one();
        self.freed.notify_all();
        Ok(())
    }

    /// How full it is, 0 to 1 or more.
    #[must_use]
    pub fn fill(&self) -> f64 {
        self.bytes() as f64 / self.max_bytes.max(1) as f64
    }

    /// Puts a request in if there is room.
    ///
    /// # Errors
    /// When too many are waiting or the queue is closed; the request comes back.
    pub fn try_request(&self, request: R) -> Result<(), Refused<R>> {
        let mut lanes = self.lock();
        if lanes.is_closed {
            return Err(Refused::Closed(request));
        }
        if lanes.requests.len() >= self.max_requests {
            return Err(Refused::Full(request));
        }
        lanes.requests.push_back(request);
        drop(lanes);
        self.arrived.notify_one();
        Ok(())
    }

    /// Takes the next item or request, waiting until `deadline`.
    pub fn pop(&self, deadline: Instant) -> Popped<T, R> {
        let left = deadline.saturating_duration_since(super::now());
        let (mut lanes, _) = self
            .arrived
            .wait_timeout_while(self.lock(), left, |lanes| !lanes.is_closed && lanes.is_empty())
            .unwrap_or_else(PoisonError::into_inner);
        if lanes.is_closed {
            lanes.items.clear();
            lanes.requests.clear();
            lanes.bytes = 0;
            return Popped::Closed;
        }
        let request_first = lanes.request_next || lanes.items.is_empty();
        if request_first && let Some(request) = lanes.requests.pop_front() {
            lanes.request_next = false;
            return Popped::Request(request);
        }
        lanes.request_next = true;
        let Some((item, bytes)) = lanes.items.pop_front() else { return Popped::Timeout };
        lanes.bytes = lanes.bytes.saturating_sub(bytes);
        drop(lanes);
        self.freed.notify_all();
        Popped::Item(item)
    }

    /// Ends the queue: who waits on either side wakes, nothing more goes in or out.
    pub fn close(&self) {
        self.lock().is_closed = true;
        self.arrived.notify_all();
        self.freed.notify_all();
    }

    /// Bytes of items that may wait.
    #[must_use]
    pub fn max_bytes(&self) -> usize {
        self.max_bytes
    }

    /// Bytes of the items waiting.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.lock().bytes
    }

    fn has_room(&self, lanes: &Lanes<T, R>, bytes: usize) -> bool {
        lanes.items.is_empty() || lanes.bytes.saturating_add(bytes) <= self.max_bytes
    }

    /// The lanes are consistent between any two statements, so a poisoned lock is as good.
    fn lock(&self) -> MutexGuard<'_, Lanes<T, R>> {
        self.lanes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T, R> Lanes<T, R> {
    fn put(&mut self, item: T, bytes: usize) {
        self.items.push_back((item, bytes));
        self.bytes = self.bytes.saturating_add(bytes);
    }

    fn is_empty(&self) -> bool {
        self.items.is_empty() && self.requests.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::thread;
    use std::time::Duration;

    /// Far enough that a test which would wait so long has failed anyway.
    fn far() -> Instant {
        super::super::now() + Duration::from_secs(30)
    }

    #[test]
    fn items_keep_their_order_and_their_bytes() {
        let queue: Queue<u32, ()> = Queue::new(100, 1);
        for i in 0..3 {
            queue.push_wait(i, 30).unwrap();
        }
        assert_eq!(queue.bytes(), 90);
        assert_eq!(queue.keep_room(30), Ok(false));
        assert_eq!(queue.pop(far()), Popped::Item(0));
        assert_eq!(queue.keep_room(30), Ok(true));
        queue.push_kept([(3, 30)], 30).unwrap();
        for i in 1..4 {
            assert_eq!(queue.pop(far()), Popped::Item(i));
        }
        assert_eq!(queue.bytes(), 0);
        assert_eq!(queue.pop(super::super::now()), Popped::Timeout);
    }

    #[test]
    fn an_item_larger_than_the_queue_is_taken_alone() {
        let queue: Queue<u32, ()> = Queue::new(10, 1);
        assert_eq!(queue.push_wait(0, 1000), Ok(()));
        assert_eq!(queue.keep_room(1), Ok(false));
        assert_eq!(queue.pop(far()), Popped::Item(0));
        assert_eq!(queue.push_wait(1, 1), Ok(()));
    }

    #[test]
    fn room_that_is_kept_is_nobody_elses() {
        let queue: Queue<u32, ()> = Queue::new(100, 1);
        assert_eq!(queue.keep_room(80), Ok(true));
        assert_eq!((queue.bytes(), queue.keep_room(30)), (80, Ok(false)));
        assert_eq!(queue.push_wait(9, 1000), Ok(()), "nothing waits: one is taken all the same");
        queue.push_kept([(0, 20), (1, 30)], 80).unwrap();
        assert_eq!(queue.bytes(), 1050);
        assert_eq!(queue.pop(far()), Popped::Item(9));
        assert!((queue.fill() - 0.5).abs() < 1e-12);
        queue.push_kept([], 0).unwrap();
        assert_eq!((queue.pop(far()), queue.pop(far())), (Popped::Item(0), Popped::Item(1)));
        assert_eq!(queue.bytes(), 0);
        queue.close();
        assert_eq!((queue.keep_room(1), queue.push_kept([], 0)), (Err(Closed), Err(Closed)));
    }

    #[test]
    fn the_lanes_take_turns() {
        let queue: Queue<u32, char> = Queue::new(100, 2);
        for i in 0..3 {
            queue.push_wait(i, 1).unwrap();
        }
        queue.try_request('a').unwrap();
        queue.try_request('b').unwrap();
        assert_eq!(queue.try_request('c'), Err(Refused::Full('c')));
        let order: Vec<_> = (0..5).map(|_| queue.pop(far())).collect();
        use Popped::{Item, Request};
        assert_eq!(order, [Request('a'), Item(0), Request('b'), Item(1), Item(2)]);
    }

    #[test]
    fn a_waiting_source_loses_nothing() {
        let queue: Arc<Queue<u32, ()>> = Arc::new(Queue::new(8, 1));
        let source = Arc::clone(&queue);
        let pushing = thread::spawn(move || (0..1000).try_for_each(|i| source.push_wait(i, 4)));
        for i in 0..1000 {
            assert_eq!(queue.pop(far()), Popped::Item(i));
            assert!(queue.bytes() <= 8);
        }
        assert_eq!(pushing.join().unwrap(), Ok(()));
    }

    #[test]
    fn closing_wakes_who_waits() {
        let queue: Arc<Queue<u32, ()>> = Arc::new(Queue::new(4, 1));
        queue.push_wait(0, 4).unwrap();
        let source = Arc::clone(&queue);
        let pushing = thread::spawn(move || source.push_wait(1, 4));
        queue.close();
        assert_eq!(pushing.join().unwrap(), Err(Closed));
        assert_eq!(queue.pop(far()), Popped::Closed);
        assert_eq!(queue.push_wait(2, 1), Err(Closed));
        assert_eq!(queue.try_request(()), Err(Refused::Closed(())));
    }
}
