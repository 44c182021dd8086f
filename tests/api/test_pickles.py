"""Pickles that earlier versions wrote, of modules that have other names by now."""

import base64
import pickle
import zlib

import pytest
import stepper
from stepper._pickles import MODULES

EARLIER = (
    r"c-mc5J8#u66t3Ev`{)A-"
    r"Dg#1DP+l#M@(?q<s1+5edO<B>Ly>di8=E?DYC9FTs1it2FnFsO;2*HCG4K;u`3DGo0NofEI8M?yG(&WJe4gL=j$bw2551B6duHbJv{X1vu~_hVswhvS(XB_N"
    r"v~T8Ln_Vz!D;i^KXjT@}VD0<Cr@wlfCJILaDK3m|(>P_cPnFS4$=NmrT?1u`8?aLttnz@XcXUT_2Ir)YO;1lrg#yaxPJVB+Cm{;N=maQ>BP0}tgx@~c@1t%="
    r"#-V_Fzy5rA_mdpxnHatB`&<azx8A-"
    r"?F%H50chQ_aC7@)gviwpJI1$dQ!JC~QE1zdx>d7KNqEKH+)60Sy7!oIv3jkwcBbU~Ah?xV#OHd5Sc8wk*G&N*Kx1T^$asZ7xBiTm`*DC7d3STOyVx;`^bW9~"
    r";G)iKes3UicfFfBtx9$0eO(zs|aMW?UP};Ep%$<Z&S>|2*TEgk&N*G;)GAStn_@@fH5IUx62#&3-3?(XyYmu9b#?-"
    r">4n*bE$AxIuzgN8L^o6o6&sn^_Eq2MXclv8Da1T7w*j44CT7MPK96<XwcWlCn9c%dQ$x#+Z)oOroMuDH`2nI~6!<eJl5?~xllvfvaqop`HO9nj%qMF(I=W|<"
    r"Czn7Uue|5JjT-ZkV5xvRZpLASBfyG(i_$H})*>r)+LC<5?I0Ui{ny_nmzf@rPfrL|nHSTzYd!<Y}ct*lNi7@p5K3J>?7J9~H`Yyh7oSSX6>?20fFwFu*QFn}"
    r"G#Nq<<=w(N!o&S104oPdlcvDoIez_G^<mtAqAo3NqXcIi60No(mwH|q>NRz4rh&k1GhR3LDBAZWhM{}F}Uws$A0aR`h;nnW;-"
    r"<~kZa0Pa>5G=RFm>M=Zoe?y?5biGs|E8(r#gI6cQJhqH(gh(OSh>!xt_J!JmUddBEvBcwmCdDIFX3`!I9K7t*SGr|5DFc1ny&(#z%+|P32>WKWyJyx7Uib%+"
    r"-P4@"
)
"""A list that was pickled before the package had folders: zlib, base 85."""


def test_a_pickle_of_an_earlier_version_is_what_it_was():
    found = pickle.loads(zlib.decompress(base64.b85decode(EARLIER)))
    motor = stepper.DCMotor(stall_torque=1.0, no_load_speed=9.0)
    assert found == [
        stepper.Options(timestep=0.004, integrator="implicit"),
        stepper.SensorModel({"hip": stepper.Transfer(noise_std=0.1, delay=0.01)}, default=stepper.Transfer(bias=0.2)),
        stepper.ActuatorModel({"hip": stepper.Drive(lag=0.02, servo=stepper.PID(kp=3.0), motor=motor)}),
        stepper.RayFan("eye", ((1.0, 0.0, 0.0),)),
        stepper.Combination({"hip": 2.0}),
        stepper.Status.DEEP,
    ]
    assert pickle.loads(pickle.dumps(found)) == found


@pytest.mark.parametrize("name", MODULES)
def test_an_earlier_module_has_its_public_classes(name):
    assert all(hasattr(MODULES[name], public) for public in MODULES[name].__all__)
