//! What is done to gradients and weights between the backward pass and the optimizer.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::optim::GradientsParams;
use burn::tensor::Tensor;
use std::collections::BTreeMap;

/// L2 norm of the whole gradient; NaN or infinite where an entry is. Reads it from the device.
pub fn norm<M: Module>(net: &M, gradients: &GradientsParams) -> f64 {
    squares(net, gradients).map_or(0.0, |sums| sums.into_data().iter::<f64>().sum::<f64>().sqrt())
}

/// Sum of the squares of each parameter's gradient, shape `[parameters]`; `None` where there is no gradient.
pub fn squares<M: Module>(net: &M, gradients: &GradientsParams) -> Option<Tensor<1>> {
    struct Squares<'a> {
        gradients: &'a GradientsParams,
        sums: Vec<Tensor<1>>,
    }
    impl ModuleVisitor for Squares<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            if let Some(g) = self.gradients.get::<D>(param.id) {
                self.sums.push((g.clone() * g).sum());
            }
        }
    }
    let mut squares = Squares { gradients, sums: Vec::new() };
    net.visit(&mut squares);
    (!squares.sums.is_empty()).then(|| Tensor::cat(squares.sums, 0))
}

/// What gradients are multiplied by.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "one at a time")]
pub enum Factor {
    /// A number at hand.
    Number(f64),
    /// One that is still being computed, shape `[1]`.
    OnDevice(Tensor<1>),
}

/// Multiplies every gradient.
pub fn scale<M: Module>(net: &M, gradients: &mut GradientsParams, factor: Factor) {
    struct Scale<'a> {
        gradients: &'a mut GradientsParams,
        factor: Factor,
    }
    impl ModuleVisitor for Scale<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            if let Some(g) = self.gradients.remove::<D>(param.id) {
                let scaled = match &self.factor {
                    Factor::Number(number) => g * *number,
                    Factor::OnDevice(factor) => g * factor.clone().reshape([1; D]),
                };
                self.gradients.register(param.id, scaled);
            }
        }
    }
    net.visit(&mut Scale { gradients, factor });
}

/// The running statistics of a network's batch norms, by reference: a step whose loss turns out not to be finite
/// has already changed them.
pub struct Statistics(BTreeMap<ParamId, Tensor<1>>);

impl Statistics {
    /// As they are now.
    pub fn of<M: Module>(net: &M) -> Statistics {
        struct Collect(BTreeMap<ParamId, Tensor<1>>);
        impl ModuleVisitor for Collect {
            fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
                let value = param.val();
                if D == 1 && !value.is_require_grad() {
                    let n: usize = value.dims().iter().product();
                    self.0.insert(param.id, value.reshape([n]));
                }
            }
        }
        let mut collect = Collect(BTreeMap::new());
        net.visit(&mut collect);
        Statistics(collect.0)
    }

    /// Whether all are finite. Reads from the device.
    pub fn are_finite(&self) -> bool {
        self.sums().is_none_or(|sums| sums.into_data().iter::<f64>().all(f64::is_finite))
    }

    /// Sum of each, shape `[statistics]`: not finite where one of them is not. `None` where there are none.
    pub fn sums(&self) -> Option<Tensor<1>> {
        let sums: Vec<Tensor<1>> = self.0.values().map(|t| t.clone().without_autodiff().sum()).collect();
        (!sums.is_empty()).then(|| Tensor::cat(sums, 0))
    }

    /// Puts them back.
    pub fn restore<M: Module>(self, net: M) -> M {
        struct Restore(BTreeMap<ParamId, Tensor<1>>);
        impl ModuleMapper for Restore {
            fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
                match self.0.remove(&param.id) {
                    Some(old) => param.map(|new| {
                        let shape = new.dims();
                        old.reshape(shape)
                    }),
                    None => param,
                }
            }
        }
        net.map(&mut Restore(self.0))
    }
}

/// Moves `average` towards `net`: decay * average + (1 - decay) * net, running statistics included. Both have the
/// same parameter ids.
pub fn average<M: Module>(average: M, net: &M, decay: f64) -> M {
    struct Collect(BTreeMap<ParamId, Tensor<1>>);
    impl ModuleVisitor for Collect {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let value = param.val();
            let n: usize = value.dims().iter().product();
            self.0.insert(param.id, value.detach().inner().reshape([n]));
        }
    }
    struct Mix(BTreeMap<ParamId, Tensor<1>>, f64);
    impl ModuleMapper for Mix {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            match self.0.remove(&param.id) {
                Some(new) => param.map(|old| {
                    let shape = old.dims();
                    old * self.1 + new.reshape(shape) * (1.0 - self.1)
                }),
                None => param,
            }
        }
    }
    let mut collect = Collect(BTreeMap::new());
    net.visit(&mut collect);
    average.map(&mut Mix(collect.0, decay))
}
