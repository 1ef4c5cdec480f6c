"""From samples to one regression: columns that are named, triangular factors, prior and noise.

In come samples and the terms of the joints; out goes a small triangular system that any solver
can take, with its closed solution, and which combinations of parameters the motion identifies.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'base_parameters': ['BaseParameters', 'find_base_parameters'],
        'excitation_check': ['excitation_warnings'],
        'model_fit': ['ModelFit', 'fit_model'],
        'noise': ['Noise', 'noise_from_residuals'],
        'prior': ['Prior', 'prior_from_cad'],
        'reduced_regression': ['ReducedRegression', 'TriangularSystem', 'triangular_factor'],
        'regression_bank': ['RegressionBank'],
        'regularised_regression': ['posterior_covariance', 'solve_regularised'],
        'sample_columns': ['Prediction', 'SampleColumns'],
    },
)
