/*
 * four_bar: explicit formulas, made by spherekit 0.1.0.
 * R. Di Gregorio, Dynamic model of single-DOF spherical mechanisms based on
 * instantaneous pole axes and Eksergian's equation, Mechanism and Machine Theory,
 * 2024, 105720, Tables 1 and 2, Figs. 3 and 5
 *
 * Nothing is iterated; results are NaN where the mode does not close. A mode is one
 * side of each dyad: where a dyad is in line at an input, at a change point, a motion
 * without a jump may continue on the other side.
 *
 * motion:
 *   [0] q (rad)
 *   [1] dq (rad/s)
 *   [2] ddq (rad/s2)
 *
 * mode:
 *   [0] sign_1 (+1 or -1: the side of a dyad)
 *
 * size: none
 *
 * result:
 *   [0] theta_32 (rad)
 *   [1] theta_43 (rad)
 *   [2] theta_41 (rad)
 *   [3] transmission_angle_43 (rad)
 *   [4] velocity_coefficient_2_1
 *   [5] velocity_coefficient_3_1
 *   [6] velocity_coefficient_4_1
 *   [7] acceleration_coefficient_2_1 (1/rad)
 *   [8] acceleration_coefficient_3_1 (1/rad)
 *   [9] acceleration_coefficient_4_1 (1/rad)
 *   [10] B (kg m2)
 *   [11] dB_dq (kg m2/rad)
 *   [12] torque (N m)
 *
 * assembly modes, each with inputs (rad) at which it is known:
 *   0 (+, p1): mode 1; inputs 3.24631
 *   1 (-, p0): mode -1; inputs 3.24631
 * Before this file was written, each mode was compared with the mechanism at 20 inputs
 * or more. All pair variables agree to 8.9e-16 rad.
 */
#include <math.h>

/* To be declared where they are called. */
void four_bar(const double motion[], const double mode[], const double size[], double result[]);

enum {
    four_bar_theta_32 = 0,
    four_bar_theta_43 = 1,
    four_bar_theta_41 = 2,
    four_bar_transmission_angle_43 = 3,
    four_bar_velocity_coefficient_2_1 = 4,
    four_bar_velocity_coefficient_3_1 = 5,
    four_bar_velocity_coefficient_4_1 = 6,
    four_bar_acceleration_coefficient_2_1 = 7,
    four_bar_acceleration_coefficient_3_1 = 8,
    four_bar_acceleration_coefficient_4_1 = 9,
    four_bar_B = 10,
    four_bar_dB_dq = 11,
    four_bar_torque = 12
};

const double four_bar_modes[2][1] = {
    {1.0},
    {-1.0}
};

void four_bar(const double motion[], const double mode[], const double size[], double result[])
{
    (void)size;
    const double t0 = sin(motion[0]);
    const double t1 = 0.8660254037844386 * t0;
    const double t2 = cos(motion[0]);
    const double t3 = 0.8660254037844386 * t2;
    const double t4 = 0.3420201433256687 * t3;
    const double t5 = 0.4698463103929543 + t4;
    const double t6 = 1.0 + t5;
    const double t7 = 0.3420201433256687 * t0;
    const double t8 = t7 * t7;
    const double t9 = (-0.5000000000000001) * t2;
    const double t10 = 0.3420201433256687 * t9;
    const double t11 = 0.8137976813493737 + t10;
    const double t12 = t11 * t11;
    const double t13 = t8 + t12;
    const double t14 = t6 * t6;
    const double t15 = t13 + t14;
    const double t16 = 1.1080645864446466 / t15;
    const double t17 = t6 * t16;
    const double t18 = t5 - 1.0;
    const double t19 = t18 * t18;
    const double t20 = t13 + t19;
    const double t21 = (-0.4240242997933092) / t20;
    const double t22 = t18 * t21;
    const double t23 = t17 + t22;
    const double t24 = t5 + t23;
    const double t25 = 0.3501037691048549 * t24;
    const double t26 = t5 - t23;
    const double t27 = (-0.7140740033710573) * t26;
    const double t28 = t25 + t27;
    const double t29 = t1 * t28;
    const double t30 = (-0.5000000000000001) * t0;
    const double t31 = t11 * t16;
    const double t32 = t11 * t21;
    const double t33 = t31 + t32;
    const double t34 = 0.5 * t15;
    const double t35 = 0.6579798566743311 - t34;
    const double t36 = 0.5 * t20;
    const double t37 = t36 - 0.13397459621556132;
    const double t38 = t35 * t37;
    const double t39 = (-1.0) * t38;
    const double t40 = sqrt(t39);
    const double t41 = mode[0] * t40;
    const double t42 = (-4.0) * t41;
    const double t43 = t15 * t20;
    const double t44 = t42 / t43;
    const double t45 = t7 * t44;
    const double t46 = t33 - t45;
    const double t47 = t11 + t46;
    const double t48 = 0.3501037691048549 * t47;
    const double t49 = t11 - t46;
    const double t50 = (-0.7140740033710573) * t49;
    const double t51 = t48 + t50;
    const double t52 = t30 * t51;
    const double t53 = t7 * t16;
    const double t54 = t7 * t21;
    const double t55 = t53 + t54;
    const double t56 = t11 * t44;
    const double t57 = t55 + t56;
    const double t58 = t7 + t57;
    const double t59 = 0.3501037691048549 * t58;
    const double t60 = t7 - t57;
    const double t61 = (-0.7140740033710573) * t60;
    const double t62 = t59 + t61;
    const double t63 = t2 * t62;
    const double t64 = t52 - t63;
    const double t65 = t29 + t64;
    const double t66 = (-0.9396926207859085) * t3;
    const double t67 = 0.17101007166283438 + t66;
    const double t68 = t28 * t67;
    const double t69 = (-0.9396926207859085) * t0;
    const double t70 = t69 * t62;
    const double t71 = (-0.9396926207859085) * t9;
    const double t72 = 0.2961981327260238 + t71;
    const double t73 = t72 * t51;
    const double t74 = t70 + t73;
    const double t75 = t68 + t74;
    const double t76 = atan2(t65, t75);
    const double t77 = t11 * t23;
    const double t78 = t5 * t46;
    const double t79 = t77 - t78;
    const double t80 = (-1.0641777724759123) * t79;
    const double t81 = 0.18198511713310123 * t57;
    const double t82 = (-1.373738709727311) * t57;
    const double t83 = t81 + t82;
    const double t84 = t80 * t83;
    const double t85 = t5 * t57;
    const double t86 = t7 * t23;
    const double t87 = t85 - t86;
    const double t88 = (-1.0641777724759123) * t87;
    const double t89 = 0.18198511713310123 * t46;
    const double t90 = (-1.373738709727311) * t46;
    const double t91 = t89 + t90;
    const double t92 = t88 * t91;
    const double t93 = t84 + t92;
    const double t94 = 1.0 + t23;
    const double t95 = 0.18198511713310123 * t94;
    const double t96 = 1.0 - t23;
    const double t97 = 1.373738709727311 * t96;
    const double t98 = t95 + t97;
    const double t99 = t7 * t46;
    const double t100 = t11 * t57;
    const double t101 = t99 - t100;
    const double t102 = (-1.0641777724759123) * t101;
    const double t103 = t98 * t102;
    const double t104 = t93 + t103;
    const double t105 = (-0.3420201433256689) * t28;
    const double t106 = 0.5 * t24;
    const double t107 = 0.4999999999999999 * t26;
    const double t108 = t106 + t107;
    const double t109 = 0.9396926207859084 * t108;
    const double t110 = t105 + t109;
    const double t111 = t98 * t110;
    const double t112 = (-0.3420201433256689) * t62;
    const double t113 = 0.5 * t58;
    const double t114 = 0.4999999999999999 * t60;
    const double t115 = t113 + t114;
    const double t116 = 0.9396926207859084 * t115;
    const double t117 = t112 + t116;
    const double t118 = t83 * t117;
    const double t119 = (-0.3420201433256689) * t51;
    const double t120 = 0.5 * t47;
    const double t121 = 0.4999999999999999 * t49;
    const double t122 = t120 + t121;
    const double t123 = 0.9396926207859084 * t122;
    const double t124 = t119 + t123;
    const double t125 = t91 * t124;
    const double t126 = t118 + t125;
    const double t127 = t111 + t126;
    const double t128 = atan2(t104, t127);
    const double t129 = (-0.766044443118978) * t83;
    const double t130 = 0.49999999999999994 * t57;
    const double t131 = 0.5 * t57;
    const double t132 = t130 + t131;
    const double t133 = 0.6427876096865393 * t132;
    const double t134 = t129 + t133;
    const double t135 = (-0.766044443118978) * t91;
    const double t136 = 0.49999999999999994 * t46;
    const double t137 = 0.5 * t46;
    const double t138 = t136 + t137;
    const double t139 = 0.6427876096865393 * t138;
    const double t140 = t135 + t139;
    const double t141 = (-1.0) * t140;
    const double t142 = atan2(t134, t141);
    const double t143 = 0.9396926207859083 * t62;
    const double t144 = 0.3420201433256688 * t115;
    const double t145 = t143 + t144;
    const double t146 = 0.9396926207859083 * t51;
    const double t147 = 0.3420201433256688 * t122;
    const double t148 = t146 + t147;
    const double t149 = t7 * t148;
    const double t150 = t11 * t145;
    const double t151 = t149 - t150;
    const double t152 = t145 * t151;
    const double t153 = t152 * t152;
    const double t154 = t148 * t151;
    const double t155 = t154 * t154;
    const double t156 = t153 + t155;
    const double t157 = 0.9396926207859083 * t28;
    const double t158 = 0.3420201433256688 * t108;
    const double t159 = t157 + t158;
    const double t160 = t11 * t159;
    const double t161 = t5 * t148;
    const double t162 = t160 - t161;
    const double t163 = t145 * t162;
    const double t164 = (-1.0) * t163;
    const double t165 = t5 * t145;
    const double t166 = t7 * t159;
    const double t167 = t165 - t166;
    const double t168 = t148 * t167;
    const double t169 = t164 - t168;
    const double t170 = t169 * t169;
    const double t171 = t156 + t170;
    const double t172 = sqrt(t171);
    const double t173 = t148 * t162;
    const double t174 = t145 * t167;
    const double t175 = t173 - t174;
    const double t176 = t175 * t175;
    const double t177 = sqrt(t176);
    const double t178 = atan2(t172, t177);
    const double t179 = 1.0 / t151;
    const double t180 = t151 * t179;
    const double t181 = (-0.8660254037844386) * t145;
    const double t182 = t7 * t181;
    const double t183 = t179 * t182;
    const double t184 = t183 * t183;
    const double t185 = 0.8660254037844386 * t151;
    const double t186 = t11 * t181;
    const double t187 = t185 - t186;
    const double t188 = t179 * t187;
    const double t189 = t188 * t188;
    const double t190 = t184 + t189;
    const double t191 = 0.5000000000000001 * t151;
    const double t192 = t5 * t181;
    const double t193 = t191 - t192;
    const double t194 = t179 * t193;
    const double t195 = t194 * t194;
    const double t196 = t190 + t195;
    const double t197 = sqrt(t196);
    const double t198 = 0.8660254037844386 * t5;
    const double t199 = 0.5000000000000001 * t11;
    const double t200 = t198 - t199;
    const double t201 = t200 * t145;
    const double t202 = 0.5000000000000001 * t7;
    const double t203 = t202 * t148;
    const double t204 = t201 + t203;
    const double t205 = 0.8660254037844386 * t7;
    const double t206 = t159 * t205;
    const double t207 = t204 - t206;
    const double t208 = t179 * t207;
    const double t209 = t179 * t181;
    const double t210 = t179 * t185;
    const double t211 = t5 * t210;
    const double t212 = t179 * t191;
    const double t213 = t11 * t212;
    const double t214 = t211 - t213;
    const double t215 = t209 * t214;
    const double t216 = (-1.0) * t215;
    const double t217 = t205 * t179;
    const double t218 = t159 * t188;
    const double t219 = t148 * t194;
    const double t220 = t218 - t219;
    const double t221 = t217 * t220;
    const double t222 = t216 - t221;
    const double t223 = t148 * t222;
    const double t224 = t7 * t212;
    const double t225 = t209 * t224;
    const double t226 = (-1.0) * t225;
    const double t227 = t145 * t194;
    const double t228 = t159 * t183;
    const double t229 = t227 + t228;
    const double t230 = t217 * t229;
    const double t231 = t226 - t230;
    const double t232 = t145 * t231;
    const double t233 = t223 - t232;
    const double t234 = t179 * t233;
    const double t235 = t11 * t234;
    const double t236 = (-1.0) * t235;
    const double t237 = t236 - t225;
    const double t238 = 1.0 / t197;
    const double t239 = t188 * t238;
    const double t240 = t237 * t239;
    const double t241 = t7 * t234;
    const double t242 = (-1.0) * t241;
    const double t243 = t242 - t215;
    const double t244 = t183 * t238;
    const double t245 = t243 * t244;
    const double t246 = t240 - t245;
    const double t247 = t7 * t210;
    const double t248 = t209 * t247;
    const double t249 = t5 * t234;
    const double t250 = t248 - t249;
    const double t251 = t194 * t238;
    const double t252 = t250 * t251;
    const double t253 = t246 + t252;
    const double t254 = t5 * t231;
    const double t255 = t148 * t183;
    const double t256 = (-1.0) * t255;
    const double t257 = t145 * t188;
    const double t258 = t256 - t257;
    const double t259 = t217 * t258;
    const double t260 = t248 - t259;
    const double t261 = t11 * t260;
    const double t262 = t254 - t261;
    const double t263 = t145 * t262;
    const double t264 = t7 * t260;
    const double t265 = t5 * t222;
    const double t266 = t264 - t265;
    const double t267 = t148 * t266;
    const double t268 = t263 + t267;
    const double t269 = t11 * t222;
    const double t270 = t7 * t231;
    const double t271 = t269 - t270;
    const double t272 = t159 * t271;
    const double t273 = t268 + t272;
    const double t274 = t179 * t273;
    const double t275 = t179 * t179;
    const double t276 = 0.011325 * t151;
    const double t277 = t151 * t276;
    const double t278 = 0.8660254037844386 * t88;
    const double t279 = 0.5000000000000001 * t102;
    const double t280 = t278 + t279;
    const double t281 = t151 * t280;
    const double t282 = t281 * t281;
    const double t283 = 0.5000000000000001 * t28;
    const double t284 = 0.8660254037844386 * t51;
    const double t285 = t283 + t284;
    const double t286 = t151 * t285;
    const double t287 = 0.6315321428571429 * t286;
    const double t288 = 0.5000000000000001 * t108;
    const double t289 = 0.8660254037844386 * t122;
    const double t290 = t288 + t289;
    const double t291 = t151 * t290;
    const double t292 = t291 - t181;
    const double t293 = (-0.3613817142857143) * t292;
    const double t294 = t287 + t293;
    const double t295 = t286 * t294;
    const double t296 = t282 + t295;
    const double t297 = (-0.3613817142857143) * t286;
    const double t298 = 0.3684678571428571 * t292;
    const double t299 = t297 + t298;
    const double t300 = t292 * t299;
    const double t301 = t296 + t300;
    const double t302 = t277 + t301;
    const double t303 = 0.6427876096865393 * t207;
    const double t304 = 0.4872332857142857 * t303;
    const double t305 = 0.766044443118978 * t207;
    const double t306 = (-0.16909457142857143) * t305;
    const double t307 = t304 + t306;
    const double t308 = t303 * t307;
    const double t309 = (-0.16909457142857143) * t303;
    const double t310 = 0.08419528571428571 * t305;
    const double t311 = t309 + t310;
    const double t312 = t305 * t311;
    const double t313 = t308 + t312;
    const double t314 = t302 + t313;
    const double t315 = t275 * t314;
    const double t316 = 7.0 * t315;
    const double t317 = t80 * t243;
    const double t318 = t88 * t237;
    const double t319 = t317 + t318;
    const double t320 = t102 * t250;
    const double t321 = t319 + t320;
    const double t322 = t281 * t321;
    const double t323 = t62 * t243;
    const double t324 = t51 * t237;
    const double t325 = t323 + t324;
    const double t326 = t28 * t250;
    const double t327 = t325 + t326;
    const double t328 = t294 * t327;
    const double t329 = t322 + t328;
    const double t330 = t115 * t243;
    const double t331 = t122 * t237;
    const double t332 = t330 + t331;
    const double t333 = t108 * t250;
    const double t334 = t332 + t333;
    const double t335 = t299 * t334;
    const double t336 = t329 + t335;
    const double t337 = t98 * t274;
    const double t338 = t307 * t337;
    const double t339 = 0.49999999999999994 * t94;
    const double t340 = (-0.5) * t96;
    const double t341 = t339 + t340;
    const double t342 = t341 * t274;
    const double t343 = t311 * t342;
    const double t344 = t338 + t343;
    const double t345 = t336 + t344;
    const double t346 = t179 * t345;
    const double t347 = 7.0 * t346;
    const double t348 = 2.0 * t347;
    const double t349 = motion[1] * t179;
    const double t350 = t181 * t349;
    const double t351 = t185 * t349;
    const double t352 = t5 * t351;
    const double t353 = t191 * t349;
    const double t354 = t11 * t353;
    const double t355 = t352 - t354;
    const double t356 = t350 * t355;
    const double t357 = (-1.0) * t356;
    const double t358 = t205 * t349;
    const double t359 = t187 * t349;
    const double t360 = t159 * t359;
    const double t361 = t193 * t349;
    const double t362 = t148 * t361;
    const double t363 = t360 - t362;
    const double t364 = t358 * t363;
    const double t365 = t357 - t364;
    const double t366 = t148 * t365;
    const double t367 = t7 * t353;
    const double t368 = t350 * t367;
    const double t369 = (-1.0) * t368;
    const double t370 = t145 * t361;
    const double t371 = t182 * t349;
    const double t372 = t159 * t371;
    const double t373 = t370 + t372;
    const double t374 = t358 * t373;
    const double t375 = t369 - t374;
    const double t376 = t145 * t375;
    const double t377 = t366 - t376;
    const double t378 = t179 * t377;
    const double t379 = t7 * t378;
    const double t380 = (-1.0) * t379;
    const double t381 = t380 - t356;
    const double t382 = t80 * t381;
    const double t383 = t11 * t378;
    const double t384 = (-1.0) * t383;
    const double t385 = t384 - t368;
    const double t386 = t88 * t385;
    const double t387 = t382 + t386;
    const double t388 = t7 * t351;
    const double t389 = t350 * t388;
    const double t390 = t5 * t378;
    const double t391 = t389 - t390;
    const double t392 = t102 * t391;
    const double t393 = t387 + t392;
    const double t394 = t281 * t393;
    const double t395 = t62 * t381;
    const double t396 = t51 * t385;
    const double t397 = t395 + t396;
    const double t398 = t28 * t391;
    const double t399 = t397 + t398;
    const double t400 = t294 * t399;
    const double t401 = t394 + t400;
    const double t402 = t115 * t381;
    const double t403 = t122 * t385;
    const double t404 = t402 + t403;
    const double t405 = t108 * t391;
    const double t406 = t404 + t405;
    const double t407 = t299 * t406;
    const double t408 = t401 + t407;
    const double t409 = t5 * t375;
    const double t410 = t148 * t371;
    const double t411 = (-1.0) * t410;
    const double t412 = t145 * t359;
    const double t413 = t411 - t412;
    const double t414 = t358 * t413;
    const double t415 = t389 - t414;
    const double t416 = t11 * t415;
    const double t417 = t409 - t416;
    const double t418 = t145 * t417;
    const double t419 = t7 * t415;
    const double t420 = t5 * t365;
    const double t421 = t419 - t420;
    const double t422 = t148 * t421;
    const double t423 = t418 + t422;
    const double t424 = t11 * t365;
    const double t425 = t7 * t375;
    const double t426 = t424 - t425;
    const double t427 = t159 * t426;
    const double t428 = t423 + t427;
    const double t429 = t179 * t428;
    const double t430 = t98 * t429;
    const double t431 = t307 * t430;
    const double t432 = t341 * t429;
    const double t433 = t311 * t432;
    const double t434 = t431 + t433;
    const double t435 = t408 + t434;
    const double t436 = motion[2] * t179;
    const double t437 = t314 * t436;
    const double t438 = t435 + t437;
    const double t439 = t179 * t438;
    const double t440 = 7.0 * t439;
    const double t441 = (-1.0) * t0;
    const double t442 = t151 * t349;
    const double t443 = 2.0 * t442;
    const double t444 = t441 - t443;
    const double t445 = t151 * t444;
    const double t446 = sin(t142);
    const double t447 = (-5.0) * t446;
    const double t448 = t207 * t349;
    const double t449 = 2.0 * t448;
    const double t450 = t447 - t449;
    const double t451 = t207 * t450;
    const double t452 = t445 + t451;
    const double t453 = t452 / t151;
    const double t454 = t440 - t453;
    result[four_bar_theta_32] = t76;
    result[four_bar_theta_43] = t128;
    result[four_bar_theta_41] = t142;
    result[four_bar_transmission_angle_43] = t178;
    result[four_bar_velocity_coefficient_2_1] = t180;
    result[four_bar_velocity_coefficient_3_1] = t197;
    result[four_bar_velocity_coefficient_4_1] = t208;
    result[four_bar_acceleration_coefficient_2_1] = 0.0;
    result[four_bar_acceleration_coefficient_3_1] = t253;
    result[four_bar_acceleration_coefficient_4_1] = t274;
    result[four_bar_B] = t316;
    result[four_bar_dB_dq] = t348;
    result[four_bar_torque] = t454;
}
