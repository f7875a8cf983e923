//! The same cases timed on a computer. What counts is the Cortex-M4 (`.ci/cost`); this is for those
//! who look here: `cargo bench -p cost`.

use cost::Meter;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

struct Timer<'c>(&'c mut Criterion);

impl Meter for Timer<'_> {
    fn case(&mut self, name: &str, units: usize, mut work: impl FnMut()) {
        let mut group = self.0.benchmark_group(name);
        group.throughput(Throughput::Elements(units as u64));
        group.bench_function("call", |bencher| bencher.iter(&mut work));
        group.finish();
    }
}

fn every_case(criterion: &mut Criterion) {
    cost::all(&mut Timer(criterion));
}

criterion_group!(host, every_case);
criterion_main!(host);
