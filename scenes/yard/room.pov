// A yard of 26 x 24 m between a house, a garage and a fence, under an overcast sky: x -13..13, y up from 0, z -12..12.
// The caller declares Cam_Location, Cam_Right, Cam_Down, Cam_Forward and Depth (see scenes/render.py).
#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 2 ambient_light rgb 1 }
#include "../room/macros.inc"

camera { perspective location Cam_Location right 2 * Cam_Right up -2 * Cam_Down direction Cam_Forward }

#if (Depth)
  fog { fog_type 1 distance 4 color rgb 1 }
  background { rgb 0 }
#else
  light_source { <-14, 26, -16> rgb <1.0, 0.95, 0.85> * 1.5 area_light x * 3, z * 3, 3, 3 adaptive 1 }
  light_source { <16, 20, -6> rgb <0.8, 0.9, 1.0> * 0.7 shadowless }
  light_source { <0, 5, -11> rgb 0.35 shadowless }
#end

#declare SG = seed(101);
#declare SH = seed(211);
#declare ST = seed(307);
#declare SV = seed(401);

// ---- sky: a dome within the reach of the range picture ----
sphere { 0, 30 hollow texture { pigment { bozo turbulence 0.8 octaves 7 omega 0.6
  color_map { [0 Hsv(212, 0.35, 0.75)] [0.45 Hsv(210, 0.2, 0.85)] [0.6 Hsv(205, 0.05, 0.95)] [1 Hsv(215, 0.12, 0.65)] } scale <9, 5, 9> }
  finish { ambient 0 diffuse 0 emission (Depth ? 0 : 0.9) } } }

// ---- ground: paving slabs, a worn asphalt drive, a lawn strip ----
plane { y, -0.03 Flat(Hsv(30, 0.2, 0.25)) }
#declare X = -13;
#while (X < 13)
  #declare Z = -12;
  #while (Z < 12)
    #if (X < 3 | X > 8)
      box { <X + 0.012, -0.05, Z + 0.012>, <X + 0.638, U(SG, -0.004, 0.004), Z + 0.638>
        texture { pigment { granite color_map { #local V = U(SG, 0.42, 0.72); #local H = U(SG, 20, 50); [0 Hsv(H, 0.15, V * 0.55)] [0.4 Hsv(H, 0.12, V)]
          [0.7 Hsv(H, 0.1, V * 1.12)] [1 Hsv(H, 0.2, V * 0.8)] } scale U(SG, 0.15, 0.4) translate 40 * rand(SG) } finish { Matte } } }
    #end
    #declare Z = Z + 0.65;
  #end
  #declare X = X + 0.65;
#end
box { <3, -0.05, -12>, <8.2, 0, 12> texture { pigment { granite turbulence 0.5 color_map { [0 Hsv(220, 0.05, 0.16)] [0.5 Hsv(220, 0.04, 0.3)] [0.62 Hsv(35, 0.08, 0.38)]
  [1 Hsv(220, 0.03, 0.22)] } scale 0.9 } finish { Matte } } }
#declare I = 0;
#while (I < 9)
  box { <-0.08, 0, -0.5>, <0.08, 0.004, 0.5> translate <5.6, 0, -10 + 2.4 * I> texture { pigment { bozo turbulence 0.7 color_map { [0 Hsv(50, 0.1, 0.5)] [0.4 Hsv(50, 0.1, 0.85)]
    [1 Hsv(50, 0.15, 0.9)] } scale 0.15 } finish { Matte } } }
  #declare I = I + 1;
#end
box { <-13, 0, 6.5>, <-4, 0.06, 8.2> texture { pigment { granite color_map { [0 Hsv(95, 0.7, 0.14)] [0.4 Hsv(88, 0.65, 0.36)] [0.7 Hsv(75, 0.6, 0.5)] [1 Hsv(60, 0.5, 0.3)] } scale 0.35 } finish { Matte } } }

// ---- the house: brick front at z = 9 with windows, a door, a balcony, signs ----
#declare R = 0;
#while (R < 62)
  #declare X = -13 - U(SH, 0, 0.35);
  #while (X < 2.6)
    #local L = U(SH, 0.3, 0.44);
    box { <X, R * 0.13 + 0.008, 9>, <min(X + L - 0.016, 2.6), R * 0.13 + 0.122, 9.3>
      texture { pigment { granite color_map { #local H = U(SH, 4, 22); #local V = U(SH, 0.34, 0.7); [0 Hsv(H, 0.6, V * 0.6)] [0.5 Hsv(H, 0.55, V)] [1 Hsv(H + 8, 0.35, V * 1.1)] }
        scale U(SH, 0.15, 0.4) translate 30 * rand(SH) } finish { Matte } } translate -U(SH, 0, 0.012) * z }
    #declare X = X + L;
  #end
  #declare R = R + 1;
#end
box { <-13, 0, 9.02>, <2.6, 8.1, 9.6> Flat(Hsv(35, 0.15, 0.6)) }
#macro Window(W, H, S) union {
  box { <-W / 2, -H / 2, -0.01>, <W / 2, H / 2, 0.02> texture { pigment { gradient y turbulence 0.5 octaves 5 color_map { [0 Hsv(215, 0.4, 0.12)] [0.4 Hsv(215, 0.3, 0.3)] [0.6 Hsv(205, 0.15, 0.6)]
    [1 Hsv(210, 0.3, 0.25)] } scale H * U(S, 0.6, 1.1) rotate z * U(S, -30, 30) translate 9 * rand(S) } finish { Satin } } }
  Frame(W, H, 0.09, S)
  box { <-0.035, -H / 2, -0.04>, <0.035, H / 2, 0> WoodY(S, 0.75) }
  box { <-W / 2, -0.03, -0.035>, <W / 2, 0.03, 0> WoodX(S, 0.75) }
  box { <-W / 2 - 0.1, -H / 2 - 0.1, -0.22>, <W / 2 + 0.1, -H / 2 - 0.03, 0> Flat(Hsv(40, 0.08, U(S, 0.55, 0.75))) }
  #local I = 0;
  #while (I < 5)
    object { Plant(0.3, 12, S) translate <-W / 2 + W * (I + 0.5) / 5, -H / 2 - 0.05, -0.13> }
    #local I = I + 1;
  #end
} #end
#declare I = 0;
#while (I < 5)
  object { Window(1.2, 1.5, SH) translate <-11.6 + 2.9 * I, 5.6, 8.98> }
  #if (I != 2) object { Window(1.2, 1.5, SH) translate <-11.6 + 2.9 * I, 2.1, 8.98> } #end
  #declare I = I + 1;
#end
union { box { <-0.6, 0, -0.08>, <0.6, 2.3, 0> WoodY(SH, 0.4) } box { <-0.45, 0.3, -0.1>, <-0.06, 1.0, 0> WoodY(SH, 0.55) } box { <0.06, 0.3, -0.1>, <0.45, 1.0, 0> WoodY(SH, 0.55) }
  box { <-0.45, 1.2, -0.1>, <0.45, 2.1, 0> WoodX(SH, 0.5) } object { Centred("14 B", 0.22, Hsv(48, 0.5, 0.9)) translate <0, 1.65, -0.11> }
  box { <-0.9, -0.02, -1.0>, <0.9, 0.16, 0> Flat(Hsv(35, 0.1, 0.55)) } box { <-1.1, 2.6, -1.1>, <1.1, 2.7, 0> WoodX(SH, 0.5) } translate <-5.8, 0, 8.98> }
union { box { <-1.3, -0.5, -0.06>, <1.3, 0.5, 0> Flat(Hsv(165, 0.7, 0.35)) } object { Centred("BAKERY", 0.42, Hsv(50, 0.5, 0.95)) translate <0, 0.05, -0.07> }
  object { Centred("bread and rolls since 1904", 0.15, Hsv(50, 0.2, 0.9)) translate <0, -0.33, -0.07> } translate <-8.7, 3.75, 8.95> }
union { box { <-1.0, -0.45, -0.06>, <1.0, 0.45, 0> Flat(Hsv(215, 0.75, 0.4)) } object { Centred("CYCLES", 0.36, Hsv(0, 0, 0.95)) translate <0, 0.02, -0.07> }
  object { Centred("repair . rent . oil", 0.15, Hsv(40, 0.4, 0.95)) translate <0, -0.3, -0.07> } translate <-1.4, 3.75, 8.95> }

// ---- the garage on the right, plastered, with a roller gate and posters ----
box { <8.6, 0, 2>, <13, 3.6, 11> texture { pigment { bozo turbulence 0.9 octaves 8 omega 0.7 color_map { [0 Hsv(38, 0.25, 0.55)] [0.45 Hsv(42, 0.2, 0.75)] [0.75 Hsv(45, 0.18, 0.82)] [1 Hsv(25, 0.3, 0.5)] }
  scale 1.1 } finish { Matte } } }
box { <8.3, 3.6, 1.7>, <13, 3.85, 11.2> Flat(Hsv(15, 0.3, 0.3)) }
#declare I = 0;
#while (I < 22)
  box { <8.5, 0.05 + 0.12 * I, 3.2>, <8.6, 0.155 + 0.12 * I, 6.4> texture { pigment { bozo turbulence 0.6 color_map { #local V = U(SH, 0.35, 0.6); [0 Hsv(140, 0.35, V * 0.6)] [0.5 Hsv(150, 0.3, V)]
    [1 Hsv(30, 0.5, V * 0.7)] } scale 0.3 translate 20 * rand(SH) } finish { Satin } } translate -U(SH, 0, 0.02) * x }
  #declare I = I + 1;
#end
object { Poster(1.0, 1.4, "CIRCUS", "friday at eight", SV) rotate y * 90 translate <8.58, 1.7, 7.4> }
object { Poster(0.9, 1.2, "VOTE", "blue or green", SV) rotate y * 90 translate <8.58, 1.6, 8.8> }
object { Painting(1.6, 1.2, 22, SV) rotate y * 90 translate <8.58, 1.9, 10.1> }
object { Window(1.0, 0.8, SH) translate <10.8, 2.3, 1.98> }
object { Poster(0.8, 1.1, "LOST CAT", "answers to Ada", SV) translate <9.4, 1.5, 1.98> }
object { Painting(1.3, 1.0, 18, SV) translate <12.2, 1.6, 1.98> }

// ---- a board fence on the left ----
#declare Z = -12;
#while (Z < 9)
  box { <-13.05, 0.1, Z + 0.015>, <-13, 1.9 + U(ST, 0, 0.15), Z + 0.215> WoodY(ST, U(ST, 0.35, 0.7)) }
  #declare Z = Z + 0.23;
#end
box { <-13, 0.5, -12>, <-12.95, 0.62, 9> Wood(ST, 0.45) }
box { <-13, 1.5, -12>, <-12.95, 1.62, 9> Wood(ST, 0.45) }

// ---- trees, a car, a wagon, bins, benches, bicycles, a bus stop, lamp posts ----
#macro Tree(H, R, N, S) union {
  cone { 0, 0.22, y * H * 0.6, 0.12 WoodY(S, 0.3) }
  #local I = 0;
  #while (I < N)
    #local A = 360 * rand(S); #local B = U(S, -70, 90); #local Q = R * U(S, 0.35, 1);
    sphere { vrotate(vrotate(x * Q, z * B), y * A) + y * H * 0.8, U(S, 0.18, 0.42)
      texture { pigment { granite color_map { #local G = U(S, 60, 120); [0 Hsv(G, 0.75, 0.08)] [0.5 Hsv(G, 0.65, U(S, 0.2, 0.5))] [1 Hsv(G - 15, 0.6, 0.6)] } scale 0.3 translate 30 * rand(S) } finish { Matte } } }
    #local I = I + 1;
  #end
} #end
object { Tree(4.2, 1.5, 150, ST) translate <-8.8, 0, 2.6> }
object { Tree(3.4, 1.2, 110, ST) translate <2.3, 0, 6.6> }
object { Tree(3.0, 1.1, 100, ST) translate <-11.6, 0, -2.5> }
#macro Wheel(S) union { torus { 0.27, 0.07 rotate x * 90 Flat(Hsv(0, 0, 0.08)) } cylinder { -0.05 * z, 0.05 * z, 0.22 texture { pigment { radial frequency 7
  color_map { [0 Hsv(0, 0, 0.75)] [0.5 Hsv(0, 0, 0.75)] [0.5 Hsv(0, 0, 0.2)] [1 Hsv(0, 0, 0.2)] } rotate x * 90 } finish { Satin } } } } #end
#macro Car(H, S, Txt) union {
  superellipsoid { <0.25, 0.2> scale <2.0, 0.42, 0.82> translate y * 0.68 texture { pigment { bozo turbulence 0.4 color_map { [0 Hsv(H, 0.75, 0.4)] [0.6 Hsv(H, 0.7, 0.6)] [1 Hsv(H, 0.5, 0.7)] } scale 1.3 } finish { Satin } } }
  superellipsoid { <0.35, 0.3> scale <1.15, 0.4, 0.72> translate <-0.15, 1.25, 0> texture { pigment { gradient x turbulence 0.4 color_map { [0 Hsv(210, 0.3, 0.15)] [0.5 Hsv(210, 0.2, 0.5)] [1 Hsv(210, 0.3, 0.2)] } scale 0.9 } finish { Satin } } }
  box { <-1.15, 1.6, -0.65>, <0.8, 1.66, 0.65> texture { pigment { Hsv(H, 0.7, 0.5) } finish { Satin } } }
  object { Wheel(S) translate <-1.25, 0.34, -0.78> } object { Wheel(S) translate <1.25, 0.34, -0.78> }
  object { Wheel(S) translate <-1.25, 0.34, 0.78> } object { Wheel(S) translate <1.25, 0.34, 0.78> }
  object { Centred(Txt, 0.26, Hsv(50, 0.1, 0.95)) translate <0, 0.68, -0.83> }
  box { <-0.35, 0.4, -0.86>, <0.1, 0.52, -0.83> Flat(Hsv(0, 0, 0.9)) }
} #end
object { Car(2, SV, "A. Brandt") rotate y * 62 translate <5.6, 0, 3.8> }
object { Car(218, SV, "Taxi 77") rotate -y * 78 translate <6.6, 0, -2.6> }
#macro Bench(S) union { #local I = 0; #while (I < 4) box { <-0.9, 0.42, -0.22 + 0.12 * I>, <0.9, 0.46, -0.13 + 0.12 * I> WoodX(S, U(S, 0.45, 0.7)) } box { <-0.9, 0.55 + 0.13 * I, 0.26>, <0.9, 0.64 + 0.13 * I, 0.3> WoodX(S, U(S, 0.45, 0.7)) }
  #local I = I + 1; #end box { <-0.75, 0, -0.2>, <-0.68, 1.05, 0.3> Flat(Hsv(0, 0, 0.12)) } box { <0.68, 0, -0.2>, <0.75, 1.05, 0.3> Flat(Hsv(0, 0, 0.12)) } } #end
object { Bench(ST) rotate -y * 8 translate <-6.8, 0, 5.3> }
object { Bench(ST) rotate -y * 70 translate <-10.8, 0, 0.3> }
#macro Bin(H, Txt, S) union { box { <-0.33, 0.08, -0.33>, <0.33, 1.05, 0.33> RandomTexture(S, 0.25) } box { <-0.36, 1.05, -0.38>, <0.36, 1.13, 0.36> Flat(Hsv(H, 0.7, 0.4)) }
  box { <-0.22, 0.5, -0.345>, <0.22, 0.8, -0.33> Flat(Hsv(50, 0.1, 0.95)) } object { Centred(Txt, 0.13, Hsv(H, 0.9, 0.4)) translate <0, 0.6, -0.35> } } #end
object { Bin(120, "GLASS", SV) rotate y * 8 translate <-3.6, 0, 7.9> }
object { Bin(215, "PAPER", SV) rotate -y * 5 translate <-2.7, 0, 8.0> }
object { Bin(35, "METAL", SV) rotate y * 15 translate <-1.8, 0, 7.8> }
object { Bin(0, "REST", SV) rotate y * 3 translate <-0.9, 0, 8.0> }
object { Barrel(0.42, 1.1, SV) translate <-4.2, 0, 0.8> }
object { Barrel(0.38, 1.0, SV) translate <-3.3, 0, 1.3> }
object { Crate(0.9, SV) rotate y * 28 translate <-1.4, 0, 2.2> }
object { Crate(0.7, SV) rotate -y * 12 translate <-1.3, 0.9, 2.3> }
object { Crate(0.8, SV) rotate y * 10 translate <-0.1, 0, 3.1> }
object { Carton(0.7, 0.6, 0.6, "TULIPS", SV) rotate -y * 25 translate <0.6, 0, 0.1> }
object { Carton(0.6, 0.5, 0.5, "SOIL", SV) rotate y * 15 translate <0.7, 0.6, 0.15> }
object { Barrel(0.3, 0.8, SV) translate <1.7, 0, -1.8> }
object { Plant(1.3, 60, SV) translate <-2.6, 0, -2.2> }
object { Plant(1.1, 50, SV) translate <-6.5, 0, -1.4> }
object { Plant(1.5, 60, SV) translate <9.4, 0, 0.6> }
object { Plant(1.2, 60, SV) translate <3.0, 0, 8.2> }
sphere { <-5.2, 0.35, -3.2>, 0.35 RandomTexture(SV, 0.2) }
sphere { <2.2, 0.28, 1.8>, 0.28 RandomTexture(SV, 0.15) }
union { cylinder { 0, y * 4.2, 0.06 Flat(Hsv(140, 0.4, 0.2)) } sphere { y * 4.3, 0.22 texture { pigment { crackle scale 0.15 color_map { [0 Hsv(45, 0.2, 0.4)] [0.2 Hsv(45, 0.2, 0.95)] [1 Hsv(45, 0.3, 0.85)] } } finish { Matte } } } translate <2.6, 0, 3.4> }
union { cylinder { 0, y * 4.2, 0.06 Flat(Hsv(140, 0.4, 0.2)) } sphere { y * 4.3, 0.22 RandomTexture(SV, 0.15) } translate <-7.6, 0, -0.2> }
union { // bus stop
  box { <-1.6, 0, -0.05>, <-1.5, 2.4, 0.05> Flat(Hsv(0, 0, 0.2)) } box { <1.5, 0, -0.05>, <1.6, 2.4, 0.05> Flat(Hsv(0, 0, 0.2)) } box { <-1.8, 2.4, -0.9>, <1.8, 2.5, 0.2> Flat(Hsv(210, 0.5, 0.3)) }
  object { Poster(1.2, 1.7, "ISLANDS", "ferry every morning", SV) translate <0.7, 1.25, 0> } object { Painting(1.1, 1.5, 16, SV) translate <-0.7, 1.3, 0> }
  rotate y * 38 translate <10.6, 0, -2.0> }
// ---- washing on a line: thin things before the house ----
cylinder { <-12.5, 2.4, 4.5>, <-7.0, 2.4, 5.6>, 0.015 Flat(Hsv(0, 0, 0.8)) }
#declare I = 0;
#while (I < 6)
  box { <-0.3, -0.75, 0>, <0.3, 0, 0.01> RandomTexture(SV, 0.2) rotate -y * 11.3 translate <-12.1 + 0.85 * I, 2.4, 4.58 + 0.17 * I> }
  #declare I = I + 1;
#end
box { <-13, 0, -12.2>, <13, 4, -12> Flat(Hsv(40, 0.12, 0.7)) }
box { <13, 0, -12>, <13.2, 3, 2> Flat(Hsv(20, 0.15, 0.72)) }
