//! The project's own locks, in thread schedules chosen by shuttle: at random, and by probabilistic concurrency testing
//! (Burckhardt et al., "A Randomized Scheduler with Probabilistic Guarantees of Finding Bugs", ASPLOS 2010). The tested
//! code is the project's own, with shuttle's locks instead of the standard library's (build.rs); shuttle reports
//! deadlocks and lost wake-ups as errors.
#![cfg(test)]

const ORDERS: usize = 5000;

/// Runs `threads` in schedules of both kinds; schedule changes at `DEPTH` places find most defects.
fn model(threads: impl Fn() + Send + Sync + Copy + 'static) {
    const DEPTH: usize = 3;
    shuttle::check_random(threads, ORDERS);
    shuttle::check_pct(threads, ORDERS, DEPTH);
}

mod turn {
    include!(concat!(env!("OUT_DIR"), "/turn.rs"));

    #[test]
    fn threads_take_turns_and_may_have_several() {
        use shuttle::sync::atomic::{AtomicU32, Ordering};
        crate::model(|| {
            let inside = AtomicU32::new(0);
            shuttle::thread::scope(|scope| {
                for _ in 0..3 {
                    scope.spawn(|| {
                        for _ in 0..2 {
                            let (first, second) = (Turn::wait(), Turn::wait());
                            drop(first);
                            assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0);
                            shuttle::thread::yield_now();
                            inside.fetch_sub(1, Ordering::SeqCst);
                            drop(second);
                        }
                    });
                }
            });
            assert_eq!(*owner(), None);
        });
    }
}

/// The items of the C API that the handles need.
mod result {
    #[derive(Debug)]
    pub struct Failure;

    impl Failure {
        pub fn handle(_message: impl Into<String>) -> Self {
            Self
        }
    }

    pub type Result<T> = std::result::Result<T, Failure>;
}

#[allow(dead_code, unused_imports, unused_macros)]
mod handles {
    include!(concat!(env!("OUT_DIR"), "/handles.rs"));

    #[test]
    fn a_handle_names_its_object_or_nothing() {
        crate::model(|| {
            let registry = Registry::new(1);
            let first = registry.insert("first");
            let (removed, second) = shuttle::thread::scope(|scope| {
                scope.spawn(|| {
                    let mut alive = true;
                    for _ in 0..3 {
                        let found = registry.get(first).map(|object| *object);
                        assert!(
                            found.as_ref().map_or(true, |object| alive && *object == "first"),
                            "it is another, or again"
                        );
                        alive = found.is_ok();
                    }
                });
                let removals = [(); 2].map(|()| scope.spawn(|| registry.remove(first, |_| Ok(())).is_ok()));
                let second = scope.spawn(|| registry.insert("second"));
                (removals.map(|thread| thread.join().unwrap()), second.join().unwrap())
            });
            assert!(removed[0] != removed[1], "it is destroyed once");
            assert!(first != second && registry.get(first).is_err());
            assert_eq!((*registry.get(second).unwrap(), registry.count(|_| true)), ("second", 1));
        });
    }

    #[test]
    fn what_destroys_others_when_it_goes_waits_for_nobody() {
        struct Owner<'a>(&'a Registry<u32>, u64);
        impl Drop for Owner<'_> {
            fn drop(&mut self) {
                self.0.remove(self.1, |_| Ok(())).map(drop).unwrap();
            }
        }
        crate::model(|| {
            let owned = Registry::new(2);
            let owners = Registry::new(1);
            let bits = owned.insert(7);
            let owner = owners.insert(Owner(&owned, bits));
            shuttle::thread::scope(|scope| {
                // Destroyed without references to its objects, as an engine is: one lock inside another.
                scope.spawn(|| {
                    owners
                        .remove(owner, |_| owned.count(|object| *object == 8).eq(&0).then_some(()).ok_or(Failure))
                        .map(drop)
                });
                scope.spawn(|| {
                    owners.get(owner).map(|owner| owned.get(owner.1).map(|object| assert_eq!(*object, 7)).unwrap())
                });
                scope.spawn(|| owned.insert(9));
            });
            assert_eq!((owners.count(|_| true), owned.count(|_| true)), (0, 1));
        });
    }
}
