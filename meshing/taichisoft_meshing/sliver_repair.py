"""Flat tetrahedra, mended by moving their nodes: inside the silicone freely, on surfaces within the triangles' planes.

Every node of a flat tetrahedron goes where the worst tetrahedron around it has the largest radius ratio (Freitag and
Ollivier-Gooch 1997). So surfaces keep their shape, and volumes their values, whatever the surfaces are.
"""

from dataclasses import replace
from itertools import product

import numpy as np

from taichisoft.mesh import VolumeMesh, boundary_triangles, tetrahedron_volumes
from taichisoft_meshing.closed_shells import area_vectors
from taichisoft_meshing.wall_quality import radius_ratios

SLIVER, GOOD = 0.03, 0.1
SWEEPS = 20
STEPS = 0.4 * 0.5 ** np.arange(6)
IN_PLANE = 1e-3
DIRECTIONS = np.array([way for way in product((-1.0, 0.0, 1.0), repeat=3) if any(way)])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


def without_slivers(mesh: VolumeMesh, keep_surface: bool = False) -> VolumeMesh:
    nodes, elements = mesh.nodes.copy(), mesh.elements
    if radius_ratios(nodes, elements).min() >= SLIVER:
        return mesh
    freedom = _freedoms(mesh)
    order = np.argsort(elements.ravel(), kind="stable")
    around = np.split(order // 4, np.searchsorted(elements.ravel()[order], np.arange(1, len(nodes))))
    for _ in range(SWEEPS):
        ratios = radius_ratios(nodes, elements)
        bad = np.flatnonzero(ratios < GOOD)
        moved = False
        for element in bad[np.argsort(ratios[bad], kind="stable")].tolist():
            for node in elements[element].tolist():
                moved |= _move(nodes, elements[around[node]], node, freedom.get(node, np.eye(3)))
        print("sweep", len(bad), ratios.min())
        if not moved:
            break
    return replace(mesh, nodes=nodes)

def _freedoms(mesh):
    part = np.zeros(len(mesh.elements), dtype=int)
    for number, group in enumerate(mesh.element_groups.values()):
        part[group] = number
    tri = np.vstack([boundary_triangles(mesh.elements[part == number]) for number in np.unique(part)])
    key=np.zeros(len(tri),int)
    srt={tuple(t):i for i,t in enumerate(np.sort(tri,axis=1).tolist())}
    for n,g in enumerate(mesh.surface_groups.values()):
        for t in np.sort(g,axis=1).tolist():
            i=srt.get(tuple(t))
            if i is not None: key[i]|=1<<n
    normals=area_vectors(mesh.nodes[tri]); normals/=np.linalg.norm(normals,axis=1,keepdims=True)
    out={}
    order=np.argsort(tri.ravel(),kind="stable"); ids,starts=np.unique(tri.ravel()[order],return_index=True)
    for node,its in zip(ids.tolist(),np.split(order//3,starts[1:])):
        if len(set(key[its].tolist()))>1: out[node]=np.zeros((0,3)); continue
        _,s,vt=np.linalg.svd(normals[its],full_matrices=True)
        s=np.append(s,np.zeros(3))[:3]/np.sqrt(len(its))
        out[node]=vt[s<IN_PLANE]
    return out

def _least(nodes, star, node, places):
    corners=np.tile(nodes[star],(len(places),1,1,1))
    corners=np.where((star==node)[None,:,:,None],places[:,None,None,:],corners)
    flat=corners.reshape(-1,3); el=np.arange(len(flat)).reshape(-1,4)
    r=radius_ratios(flat,el)*np.sign(tetrahedron_volumes(flat,el))
    return r.reshape(len(places),-1).min(axis=1)

def _move(nodes, star, node, axes):
    if not len(axes): return False
    ways=np.unique(np.round(DIRECTIONS@axes.T@axes,12),axis=0)
    ways=ways[np.linalg.norm(ways,axis=1)>1e-6]; ways/=np.linalg.norm(ways,axis=1,keepdims=True)
    start=least=_least(nodes,star,node,nodes[node][None])[0]
    size=np.linalg.norm(nodes[star]-nodes[node],axis=2).sum()/(3*len(star))
    if start>=GOOD: return False
    for step in STEPS:
        while True:
            places=nodes[node]+step*size*ways
            values=_least(nodes,star,node,places)
            best=int(np.argmax(values))
            if values[best]<=least*1.01+1e-6: break
            least=values[best]; nodes[node]=places[best]
            if least >= 2*GOOD: break
    return bool(least>start)
